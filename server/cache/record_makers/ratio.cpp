#include "cache/record_makers/ratio.h"

#include <algorithm>
#include <cmath>

#include "cache/record_makers/ratio_margin.h"
#include "core/error.h"
#include "derivatives/grid_assembly.h"
#include "derivatives/light_gather.h"
#include "derivatives/light_triangles.h"
#include "derivatives/random_at.h"

namespace fogbank::cache {

using derivatives::DerivativeOrder;
using derivatives::Jet3d;
using derivatives::LightProxy;
using derivatives::RadianceJet;

namespace {

/// As LightGather's.
constexpr double least_radii = 1e-12;
/// Stream of random numbers of the grids' jitter.
constexpr uint32_t jitter_stream = 0x5241u;
/// Below this share of the light's radiance a proxy is too small to divide by.
constexpr double least_proxy = 1e-6;

/// M / Mhat with gradient and Hessian (ratio-records.md section 1).
Jet3d ratio_of(const Jet3d& m, const Jet3d& proxy) {
  Jet3d rho;
  rho.value = m.value / proxy.value;
  rho.gradient = (m.gradient - rho.value * proxy.gradient) / proxy.value;
  rho.hessian =
      (m.hessian - Symmetric3d::outer_sum(rho.gradient, proxy.gradient) - proxy.hessian * rho.value) *
      (1 / proxy.value);
  return rho;
}

bool is_finite_jet(const Jet3d& jet) {
  return std::isfinite(jet.value) && is_finite(Vec3f(jet.gradient)) &&
         std::ranges::all_of(jet.hessian.entries,
                             [](double entry) { return std::isfinite(static_cast<float>(entry)); });
}

}  // namespace

transport::PlanRequest RatioRecordMaker::plan_request() { return {.from_medium = false, .max_depth = 2}; }

std::optional<LightProxy> RatioRecordMaker::make_proxy(const transport::World& world,
                                                       const transport::Plan& plan, uint32_t light,
                                                       int32_t medium) {
  if (light > std::numeric_limits<uint16_t>::max()) return std::nullopt;
  return LightProxy::make(world, plan, light, medium);
}

RatioRecordMaker::RatioRecordMaker(std::shared_ptr<const transport::World> world,
                                   const RecordMakerSettings& settings)
    : world_(std::move(world)),
      plan_(*world_, plan_request()),
      least_distance_(least_radii * static_cast<double>(world_->scene().bounds.radius)) {
  settings_.samples = settings.samples;
  settings_.seed = settings.seed;
  settings_.repeats = 1;
  derivatives::validate(settings_);
  for (derivatives::PlannedLight& planned : derivatives::planned_lights(
           *world_, plan_, derivatives::light_cells(settings_.samples), least_distance_)) {
    if (planned.lights.size() > 1) continue;
    ProxiedLight light;
    const auto media = static_cast<int32_t>(world_->scene().media.size());
    for (int32_t medium = 0; medium < media; ++medium)
      light.proxies.push_back(make_proxy(*world_, plan_, planned.lights[0], medium));
    light.gridded = std::move(planned.gridded);
    lights_.emplace(planned.lights[0], std::move(light));
  }
}

uint64_t RatioRecordMaker::id_of(const Wish& wish) const {
  return content_id(wish.position, wish.component, "ratio " + std::to_string(settings_.samples),
                    settings_.seed);
}

Record RatioRecordMaker::make(const Wish& wish, RayCounters& counters) const {
  const auto found = lights_.find(wish.component.light_group);
  const auto medium = static_cast<size_t>(wish.component.medium);
  if (found == lights_.end() || medium >= found->second.proxies.size() || !found->second.proxies[medium])
    throw Error(ErrorKind::invalid_argument, "INVALID_WISH",
                "records of ratios: light " + std::to_string(wish.component.light_group) +
                    " has no closed form here");
  const LightProxy& proxy = *found->second.proxies[medium];
  const uint64_t rays_before = counters.total();
  counters.poll();

  Record record;
  record.position = wish.position;
  record.component = wish.component;
  RandomStream random = derivatives::random_at(wish.position, settings_.seed, 0, jitter_stream);
  derivatives::LightGrid grid;
  found->second.gridded->cut(Vec3d(wish.position), random, grid);
  const bool open = !plan_.may_be_occluded(found->first, wish.position) &&
                    !plan_.may_cross_boundaries(found->first, wish.position);
  RadianceJet arriving;
  Sight sight = Sight::umbra;
  if (!grid.triangles.empty()) {
    const derivatives::SeenGrid seen(*world_, wish.position, wish.component.medium, open, grid, counters);
    derivatives::add_unoccluded(grid, seen.sigma_t(), DerivativeOrder::hessian, counters, arriving);
    if (seen.visible_count() == grid.vertices.size()) sight = Sight::lit;
    if (seen.visible_count() > 0 && seen.visible_count() < grid.vertices.size()) sight = Sight::penumbra;
    if (seen.visible_count() > 0)
      derivatives::add_cut_grid(seen, derivatives::find_silhouettes(seen, true), settings_, arriving);
    for (uint32_t i = 0; i < grid.vertices.size(); ++i) {
      if (seen.visible(i)) continue;
      record.depth.insert(Vec3f(glm::normalize(grid.vertices[i])),
                          static_cast<float>(seen.blocker_distance(i)));
    }
  }

  const RadianceJet unoccluded = proxy.jet(Vec3d(wish.position), least_distance_);
  const double least = least_proxy * static_cast<double>(luminance(proxy.radiance()));
  if (unoccluded.luminance().value > least) {
    record.proxy = static_cast<float>(unoccluded.luminance().value);
    Jet3d luminance;
    for (size_t c = 0; c < 3; ++c) {
      if (!(unoccluded.channels[c].value > 0)) continue;
      Jet3d rho = ratio_of(arriving.channels[c], unoccluded.channels[c]);
      if (!is_finite_jet(rho)) rho = Jet3d::constant(std::isfinite(rho.value) ? rho.value : 0.0);
      record.radiance[static_cast<int>(c)] =
          std::clamp(static_cast<float>(rho.value), 0.0f, proxy.greatest_ratio());
      record.gradient[c] = Vec3f(rho.gradient);
      luminance += rho * derivatives::luminance_weights[c];
    }
    for (size_t i = 0; i < 6; ++i)
      record.hessian.entries[i] = static_cast<float>(luminance.hessian.entries[i]);
  }
  record.visibility_margin =
      std::max(visibility_margin(*world_, wish.position, grid.vertices, sight, record.depth, counters),
               std::numeric_limits<float>::min());
  record.samples = static_cast<uint32_t>(std::max<uint64_t>(counters.total() - rays_before, 1));
  record.id = id_of(wish);
  return record;
}

}  // namespace fogbank::cache
