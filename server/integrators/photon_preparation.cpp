#include "integrators/photon_preparation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fogbank::integrators {

namespace {

constexpr uint32_t trace_tasks = 32;
constexpr uint32_t photon_stream = 0x70686F74u;
constexpr uint32_t pilot_stream = 0x70696C6Fu;

// Of the pilot:
constexpr uint32_t attempts = 4;
constexpr uint32_t pilot_paths = 8192;
constexpr uint32_t pilot_rays = 32;  ///< a side of the film
/// Radii, as shares of how far the camera sees.
constexpr float pilot_beam_radius = 0.02f;
constexpr float pilot_surface_radius = 0.04f;
/// A pixel as dark as this share of the mean still has its noise counted in full.
constexpr double dark_share = 0.1;
/// Rays to each side that a ray's typical radiance is the median of.
constexpr int32_t median_reach = 2;
/// Optical distance that counts as far as one can see.
constexpr float optical_distance = 4;

/// Beams that a camera ray crosses and photons that a surface finds in the first pass: where they become
/// fewer, the time of a pass goes into work that doesn't depend on the radius.
constexpr double wanted_crossings = 60;
constexpr double wanted_photons = 8;
/// Limits to the radii of the first pass, as shares of how far the camera sees.
constexpr float least_radius = 1e-4f;
constexpr float most_beam_radius = 0.05f;
/// Around corners and edges photons miss: a large radius darkens what is small.
constexpr float wanted_surface_radius = 0.02f;
constexpr float most_surface_radius = 0.04f;
/// Most paths for one that leaves beams: photons on surfaces are often the fewer, and tracing them costs less
/// than gathering beams.
constexpr double most_paths_without_beams = 4;
constexpr uint32_t least_paths = 256;

float clamped_radius(double radius, float distance, float most) {
  if (!std::isfinite(radius)) return most * distance;
  return std::clamp(static_cast<float>(radius), least_radius * distance, most * distance);
}

}  // namespace

class PhotonPreparation::LookObserver final : public PhotonObserver {
 public:
  explicit LookObserver(Look& look) : look_(look) {}
  void beam(uint32_t path, float radiance) override {
    ++look_.beams;
    look_.shares.emplace_back(path, radiance);
  }
  void photon(uint32_t path, float radiance) override {
    ++look_.photons;
    look_.shares.emplace_back(path, radiance);
  }
  void surface() override { ++look_.surfaces; }

 private:
  Look& look_;
};

uint32_t PhotonPreparation::next_round() {
  switch (round_) {
    case Round::begin:
      if (integrator_.emission().dark()) {
        if (piloting()) integrator_.set_plan({});
        pass_ = std::make_unique<PhotonPass>();
        break;
      }
      if (piloting()) distance_ = typical_distance();
      return begin_tracing();
    case Round::tracing:
      return begin_building();
    case Round::building:
      if (!piloting()) break;
      round_ = Round::looking;
      looks_.assign(size_t{pilot_rays} * pilot_rays, {});
      return pilot_rays;
    case Round::looking:
      learn();
      if (++attempt_ == attempts) integrator_.set_plan(make_plan());
      return begin_tracing();
    case Round::done:
      return 0;
  }
  pass_->sample = samples_.first;
  integrator_.publish(std::move(pass_));
  round_ = Round::done;
  return 0;
}

uint32_t PhotonPreparation::begin_tracing() {
  round_ = Round::tracing;
  if (piloting()) {
    paths_ = pilot_paths;
    beam_radius_ = pilot_beam_radius * distance_;
    surface_radius_ = pilot_surface_radius * distance_;
    points_.resize(paths_);
    beam_stride_ = 1;
  } else {
    const PhotonBeamsIntegrator::Shrinking shrinking = PhotonBeamsIntegrator::shrinking(samples_.first);
    const PhotonPlan& plan = *integrator_.plan();
    paths_ = plan.paths;
    beam_stride_ = plan.beam_stride;
    beam_radius_ = plan.beam_radius * shrinking.beams;
    surface_radius_ = plan.surface_radius * shrinking.surfaces;
  }
  traced_.assign(trace_tasks, {});
  return trace_tasks;
}

void PhotonPreparation::trace(uint32_t task, RayCounters& counters) {
  const transport::EmissionGuide& guide = piloting() ? guide_ : integrator_.plan()->guide;
  transport::Photons photons;
  const auto path_of = [&](uint32_t number) {
    return static_cast<uint32_t>(uint64_t{number} * paths_ / trace_tasks);
  };
  for (uint32_t path = path_of(task); path < path_of(task + 1); ++path) {
    counters.poll_at(path);
    // The pilot's outcome doesn't depend on the sample that it was first needed for.
    RandomStream random = piloting() ? RandomStream(samples_.seed, path, attempt_, 0, pilot_stream)
                                     : RandomStream(samples_.seed, path, 0, samples_.first, photon_stream);
    const auto count = static_cast<float>(paths_);
    const float u_box =
        std::fmin((static_cast<float>(path) + random.next_float()) / count, one_minus_epsilon);
    const transport::EmissionGuide::Sample sample = guide.sample(u_box, random);
    if (piloting()) points_[path] = sample;
    std::optional<transport::EmittedRay> ray = integrator_.emission().sample(sample.point);
    if (!ray) continue;
    ray->flux /= sample.pdf * count;
    const size_t beams_before = photons.beams.size();
    integrator_.tracer().trace(*ray, path, random, counters, photons);
    if (path % beam_stride_ != 0) photons.beams.resize(beams_before);
    for (size_t i = beams_before; i < photons.beams.size(); ++i)
      photons.beams[i].flux *= static_cast<float>(beam_stride_);
  }
  traced_[task] = std::move(photons);
}

uint32_t PhotonPreparation::begin_building() {
  std::vector<transport::PhotonBeam> beams;
  std::vector<transport::SurfacePhoton> photons;
  for (transport::Photons& part : traced_) {
    beams.insert(beams.end(), part.beams.begin(), part.beams.end());
    photons.insert(photons.end(), part.on_surfaces.begin(), part.on_surfaces.end());
    part = {};
  }
  beams_ = beams.size();
  photons_ = photons.size();
  pass_ = std::make_unique<PhotonPass>();
  if (!beams.empty()) pass_->beams.emplace(std::move(beams), beam_radius_);
  if (!photons.empty()) pass_->photons.emplace(photons, surface_radius_);
  round_ = Round::building;
  // A round has a task at least.
  return pass_->beams ? pass_->beams->part_count() : 1;
}

void PhotonPreparation::run(uint32_t task, RayCounters& counters) {
  switch (round_) {
    case Round::tracing:
      trace(task, counters);
      break;
    case Round::building:
      if (pass_->beams) pass_->beams->build_part(task);
      break;
    case Round::looking:
      look(task, counters);
      break;
    case Round::begin:
    case Round::done:
      break;
  }
}

Ray PhotonPreparation::pilot_ray(uint32_t column, uint32_t row, RandomStream& random) const {
  const Vec2i size = camera_.film_size();
  const auto pixel = [](uint32_t number, int32_t pixels) {
    return static_cast<uint32_t>((2 * uint64_t{number} + 1) * static_cast<uint64_t>(pixels) /
                                 (2 * pilot_rays));
  };
  return camera_.sample(pixel(column, size.x), pixel(row, size.y), random);
}

float PhotonPreparation::typical_distance() const {
  const scene::Scene& scene = integrator_.gather().world().scene();
  float most = scene.bounds.radius > 0 ? 2 * scene.bounds.radius : infinity;
  const int32_t medium = integrator_.gather().settings().camera_medium.value_or(scene.sensor.medium);
  if (medium != scene::none) {
    const float sigma_t = integrator_.gather().world().medium(medium).mean_sigma_t;
    if (sigma_t > 0) most = std::fmin(most, optical_distance / sigma_t);
  }
  std::vector<float> distances;
  for (uint32_t i = 0; i < pilot_rays * pilot_rays; ++i) {
    RandomStream random(samples_.seed, i % pilot_rays, i / pilot_rays, 0, pilot_stream + 1);
    const Ray ray = pilot_ray(i % pilot_rays, i / pilot_rays, random);
    scene::Hit hit;
    const bool found = scene.intersector->intersect(ray, hit);
    distances.push_back(std::fmin(found ? hit.distance : infinity, most));
  }
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return std::isfinite(*middle) && *middle > 0 ? *middle : 1.0f;
}

void PhotonPreparation::look(uint32_t row, RayCounters& counters) {
  for (uint32_t column = 0; column < pilot_rays; ++column) {
    counters.poll();
    RandomStream random(samples_.seed, column, row, attempt_, pilot_stream + 2);
    Look look;
    LookObserver observer(look);
    const Ray ray = pilot_ray(column, row, random);
    look.radiance =
        luminance(integrator_.gather().radiance(ray, *pass_, random, counters, &observer).radiance);
    // What a path adds in several places adds up.
    std::stable_sort(look.shares.begin(), look.shares.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    size_t kept = 0;
    for (size_t i = 0; i < look.shares.size(); ++i) {
      if (kept > 0 && look.shares[kept - 1].first == look.shares[i].first) {
        look.shares[kept - 1].second += look.shares[i].second;
      } else {
        look.shares[kept++] = look.shares[i];
      }
    }
    look.shares.resize(kept);
    looks_[size_t{row} * pilot_rays + column] = std::move(look);
  }
}

std::vector<double> PhotonPreparation::typical_radiance() const {
  std::vector<double> typical;
  std::vector<float> around;
  const auto side = static_cast<int32_t>(pilot_rays);
  for (int32_t y = 0; y < side; ++y) {
    for (int32_t x = 0; x < side; ++x) {
      around.clear();
      for (int32_t row = std::max(y - median_reach, 0); row <= std::min(y + median_reach, side - 1); ++row) {
        for (int32_t column = std::max(x - median_reach, 0); column <= std::min(x + median_reach, side - 1);
             ++column)
          around.push_back(looks_[static_cast<size_t>(row * side + column)].radiance);
      }
      const auto middle = around.begin() + static_cast<std::ptrdiff_t>(around.size() / 2);
      std::nth_element(around.begin(), middle, around.end());
      typical.push_back(static_cast<double>(*middle));
    }
  }
  const double mean =
      std::accumulate(typical.begin(), typical.end(), 0.0) / static_cast<double>(typical.size());
  for (double& value : typical) value += dark_share * mean;
  return typical;
}

void PhotonPreparation::learn() {
  // A ray's own radiance may come from one path alone, which would look no worse the brighter it is.
  const std::vector<double> typical = typical_radiance();
  std::vector<double> squares(paths_, 0);
  for (size_t i = 0; i < looks_.size(); ++i) {
    if (!(typical[i] > 0)) continue;
    for (const auto& [path, radiance] : looks_[i].shares)
      squares[path] += std::pow(static_cast<double>(radiance) / typical[i], 2.0);
  }
  for (uint32_t path = 0; path < paths_; ++path) {
    if (squares[path] > 0)
      trials_.push_back(
          {points_[path].point, points_[path].pdf, static_cast<float>(std::sqrt(squares[path]))});
  }
  guide_ = transport::EmissionGuide(trials_, integrator_.emission().choices());
}

PhotonPlan PhotonPreparation::make_plan() const {
  double crossings = 0;
  double crossing = 0;  // rays
  double photons = 0;
  double surfaces = 0;
  for (const Look& look : looks_) {
    crossings += look.beams;
    crossing += look.beams > 0 ? 1 : 0;
    photons += look.photons;
    surfaces += look.surfaces;
  }
  crossings /= std::max(crossing, 1.0);
  photons /= std::max(surfaces, 1.0);
  const Vec2i size = camera_.film_size();
  const auto wanted = static_cast<double>(std::clamp<int64_t>(
      int64_t{size.x} * size.y / 4, PhotonBeamsIntegrator::least_beams, PhotonBeamsIntegrator::most_beams));
  PhotonPlan plan;
  plan.guide = guide_;
  // Crossings grow with the radius, photons with its square.
  double paths = wanted;
  if (beams_ > 0) {
    const double beams_of_path = std::max(static_cast<double>(beams_) / paths_, 0.25);
    paths = std::max(wanted / beams_of_path, static_cast<double>(least_paths));
    const double found =
        photons * paths / paths_ * std::pow(wanted_surface_radius / pilot_surface_radius, 2.0);
    if (photons_ > 0)
      plan.beam_stride =
          static_cast<uint32_t>(std::clamp(wanted_photons / found, 1.0, most_paths_without_beams));
  }
  plan.paths = static_cast<uint32_t>(paths) * plan.beam_stride;
  const double more = static_cast<double>(plan.paths) / paths_;
  plan.beam_radius = clamped_radius(beam_radius_ * wanted_crossings * plan.beam_stride / (crossings * more),
                                    distance_, most_beam_radius);
  plan.surface_radius = clamped_radius(surface_radius_ * std::sqrt(wanted_photons / (photons * more)),
                                       distance_, most_surface_radius);
  return plan;
}

double PhotonPreparation::fraction() const {
  if (round_ == Round::done) return 1;
  return piloting() ? static_cast<double>(attempt_) / (attempts + 1) : 0.75;
}

}  // namespace fogbank::integrators
