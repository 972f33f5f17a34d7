#include "transport/plan.h"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <utility>

#include "transport/lights/environment_lights.h"

namespace fogbank::transport {

namespace {

constexpr size_t most_names = 4;

/// "a, b, c and 3 more"
std::string list_of(const std::vector<std::string>& names) {
  std::string text;
  for (size_t i = 0; i < names.size() && i < most_names; ++i) text += (i == 0 ? "" : ", ") + names[i];
  if (names.size() > most_names) text += " and " + std::to_string(names.size() - most_names) + " more";
  return text;
}

std::string count_of(size_t count, const std::string& noun) {
  return (count == 0 ? "no" : std::to_string(count)) + " " + noun + (count == 1 ? "" : "s");
}

std::string name_of(const scene::Shape& shape) {
  return shape.id.empty() ? "the shape at " + shape.where.to_string() : "\"" + shape.id + "\"";
}

/// Does a sample of the BSDF come from a delta lobe that bends the path; does any sample reflect at all?
struct Lobes {
  bool delta = false;
  bool any = false;
};

/// Draws from the BSDF on both sides at a few angles, texture coordinates and lobe choices. Finds every lobe
/// that is drawn with a probability over 1/64 at one of these.
Lobes lobes_of(const Bsdf& bsdf) {
  constexpr int choices = 64;
  const std::array<Vec2f, 3> uvs{Vec2f(0.1f, 0.2f), Vec2f(0.5f, 0.5f), Vec2f(0.83f, 0.71f)};
  Lobes lobes;
  for (const Vec2f& uv : uvs) {
    ShadingPoint point;
    point.frame = Frame::from_normal(Vec3f(0, 0, 1));
    point.uv = uv;
    for (const float cosine : {0.9f, 0.3f, -0.9f, -0.3f}) {
      const Vec3f wo(safe_sqrt(1 - cosine * cosine), 0, cosine);
      for (int i = 0; i < choices; ++i) {
        const float lobe = (static_cast<float>(i) + 0.5f) / choices;
        const std::optional<BsdfSample> sample = bsdf.sample(point, wo, lobe, {0.4f, 0.6f});
        if (!sample || sample->null || is_black(sample->weight)) continue;
        lobes.any = true;
        lobes.delta = lobes.delta || sample->delta;
      }
    }
  }
  return lobes;
}

struct Surfaces {
  std::vector<std::string> reflecting;
  std::vector<std::string> specular;
};

Surfaces surfaces_of(const World& world) {
  const scene::Scene& scene = world.scene();
  std::vector<int8_t> known(scene.bsdfs.size(), 0);
  std::vector<Lobes> lobes(scene.bsdfs.size());
  Surfaces surfaces;
  for (uint32_t i = 0; i < scene.shapes.size(); ++i) {
    const auto index = static_cast<size_t>(scene.shapes[i].bsdf);
    if (known[index] == 0) {
      known[index] = 1;
      lobes[index] = lobes_of(world.bsdf(i));
      // A texture may be black wherever it was asked.
      if (!world.is_null(i) && !is_black(world.bsdf(i).albedo_estimate())) lobes[index].any = true;
    }
    if (lobes[index].any && world.bsdf(i).has_smooth_lobes())
      surfaces.reflecting.push_back(name_of(scene.shapes[i]));
    if (lobes[index].delta) surfaces.specular.push_back(name_of(scene.shapes[i]));
  }
  return surfaces;
}

bool sends_light(const Light& light) {
  return light.at_infinity() ? light.fluence(Vec3f(0)) > 0 : light.bounds().intensity > 0;
}

LightTreatment treatment_of(const Light& light) {
  if (light.is_delta()) return LightTreatment::closed_form;
  if (!light.at_infinity()) return LightTreatment::light_grid;
  return dynamic_cast<const ConstantLight*>(&light) != nullptr ? LightTreatment::sphere_grid
                                                               : LightTreatment::environment_grid;
}

/// Why a term that depends on what is asked for and on the scene's content is on or off.
struct Decision {
  bool wanted = true;    ///< by the request
  std::string unwanted;  ///< why not
  bool present = true;   ///< the scene has what the term is about
  std::string absent;    ///< the sentence if it hasn't
  std::string reason;    ///< the sentence if it has
};

std::vector<std::string> names_of_emitters(const scene::Scene& scene,
                                           std::initializer_list<const char*> types) {
  std::vector<std::string> names;
  for (const scene::ObjectPointer& emitter : scene.emitters)
    for (const char* type : types)
      if (emitter->type == type)
        names.push_back(emitter->id.empty() ? emitter->type : emitter->type + " \"" + emitter->id + "\"");
  return names;
}

std::vector<std::string> names_of_area_lights(const World& world) {
  const scene::Scene& scene = world.scene();
  std::vector<std::string> names;
  for (uint32_t i = 0; i < scene.shapes.size(); ++i) {
    const scene::Shape& shape = scene.shapes[i];
    if (shape.emitter == scene::none) continue;
    const size_t primitives = shape.kind == scene::ShapeKind::triangle_mesh
                                  ? scene.meshes[static_cast<size_t>(shape.mesh)].triangles.size()
                                  : 1;
    for (uint32_t primitive = 0; primitive < primitives; ++primitive) {
      const uint32_t light = world.light_of_hit(i, primitive);
      if (light == SceneLights::no_light || !sends_light(world.lights().light(light))) continue;
      names.push_back(name_of(shape));
      break;
    }
  }
  return names;
}

}  // namespace

Plan::Plan(const World& world, const PlanRequest& request)
    : force_(!request.leave_out),
      occluders_(LightObstacles::of_all(world, ObstacleKind::occluders)),
      passing_(LightObstacles::of_all(world, ObstacleKind::passing)) {
  const scene::Scene& scene = world.scene();
  const LightSampler& lights = world.lights();
  const std::string forced = "leaving out is switched off, although ";
  const auto decide = [&](const char* term, const Decision& decision) {
    const bool on = decision.wanted && (force_ || decision.present);
    const std::string& found = decision.present ? decision.reason : decision.absent;
    terms_.push_back({term, on,
                      !decision.wanted              ? decision.unwanted
                      : force_ && !decision.present ? forced + found
                                                    : found});
    return on;
  };

  std::vector<std::string> scattering;
  std::vector<std::string> coloured;
  for (const scene::Medium& medium : scene.media) {
    const std::string name = medium.id.empty() ? "a medium without a name" : "\"" + medium.id + "\"";
    if (!is_black(medium.sigma_s())) scattering.push_back(name);
    if (!(medium.sigma_t.x == medium.sigma_t.y && medium.sigma_t.y == medium.sigma_t.z))
      coloured.push_back(name);
  }
  terms_.push_back({"in-scattering", !scattering.empty(),
                    scattering.empty()
                        ? "no medium scatters light (albedo 0): images need no records, a probe still answers"
                        : "light is scattered by " + list_of(scattering)});

  // Emitters. Depth counts edges: camera to x, x to the light.
  const bool direct = request.from_surfaces && (request.max_depth < 0 || request.max_depth >= 2);
  bool lit = force_;
  treatments_.assign(lights.size(), LightTreatment::left_out);
  for (uint32_t i = 0; i < lights.size(); ++i) {
    if (!force_ && !sends_light(lights.light(i))) continue;
    lit = true;
    if (direct) treatments_[i] = treatment_of(lights.light(i));
  }
  const auto treated = [this](LightTreatment treatment) {
    return std::find(treatments_.begin(), treatments_.end(), treatment) != treatments_.end();
  };
  const std::string indirect_only =
      request.from_surfaces ? "paths of at most " + std::to_string(request.max_depth) +
                                  (request.max_depth == 1 ? " edge" : " edges") + " end before that"
                            : "only light from the medium is asked for";
  const auto light_term = [&](const char* term, LightTreatment treatment,
                              const std::vector<std::string>& names, const std::string& absent,
                              const std::string& remark) {
    terms_.push_back({term, treated(treatment),
                      !direct         ? indirect_only
                      : names.empty() ? absent
                                      : list_of(names) + ": " + remark});
  };
  light_term("closed forms", LightTreatment::closed_form,
             names_of_emitters(scene, {"directional", "point", "spot"}), "every light has an extent",
             "no extent, so no grid; their shadows have no derivatives");
  light_term("light grids", LightTreatment::light_grid, names_of_area_lights(world),
             "no emitter has a place and an extent", "a grid each");
  light_term("environment grid", LightTreatment::environment_grid, names_of_emitters(scene, {"envmap"}),
             "no image lights the scene from outside", "cells by importance");
  light_term("constant environment", LightTreatment::sphere_grid, names_of_emitters(scene, {"constant"}),
             "no constant light comes from outside", "the same from everywhere, so the sphere grid sees it");
  describe_obstacles();

  // Camera to x, x to a surface or another point of the medium, from there to the light.
  const bool long_enough = request.max_depth < 0 || request.max_depth >= 3;
  const auto indirect = [&](bool asked_for, const char* other) {
    Decision decision;
    decision.wanted = asked_for && long_enough;
    decision.unwanted = asked_for ? "paths of at most " + std::to_string(request.max_depth) +
                                        (request.max_depth == 1 ? " edge" : " edges") + " end before that"
                                  : std::string("only light from ") + other + " is asked for";
    return decision;
  };
  const auto presence = [&](Decision& decision, bool present, const std::string& absent,
                            const std::string& reason) {
    decision.present = lit && present;
    decision.absent = lit ? absent : "no light sends anything";
    decision.reason = reason;
  };
  const Surfaces surfaces = surfaces_of(world);
  Decision decision = indirect(request.from_surfaces, "the medium");
  presence(
      decision, !surfaces.reflecting.empty(), "no surface reflects light",
      list_of(surfaces.reflecting) + " reflect" + (surfaces.reflecting.size() == 1 ? "s" : "") + " light");
  reflected_ = decide("reflected light", decision);
  presence(decision, !surfaces.specular.empty(), "no surface mirrors or refracts like glass",
           list_of(surfaces.specular) + ": delta lobes");
  mirrors_ = decide("mirrors", decision);
  decision = indirect(request.from_medium, "surfaces");
  presence(decision, !scattering.empty(), "no medium scatters light (albedo 0)",
           "light is scattered on by " + list_of(scattering));
  shells_ = decide("shells", decision);

  constant_environment_ = treated(LightTreatment::sphere_grid);
  std::string consumers;
  for (const auto& [on, name] :
       {std::pair{reflected_, "reflected light"}, std::pair{mirrors_, "mirrors"},
        std::pair{constant_environment_, "the constant environment"}, std::pair{shells_, "shells"}})
    if (on) consumers += (consumers.empty() ? "" : ", ") + std::string(name);
  terms_.push_back({"sphere grid", sphere_grid(),
                    sphere_grid() ? "serves " + consumers
                                  : "no light arrives but that of emitters with grids or closed forms"});
  chromatic_ =
      decide("chromatic transmittance",
             {true, "", !coloured.empty(), "all media are grey: one transmittance serves all channels",
              "extinction differs between channels in " + list_of(coloured)});
}

void Plan::describe_obstacles() {
  const auto describe = [this](const char* term, const std::vector<LightObstacles>& obstacles,
                               const std::string& what, const std::string& never) {
    size_t grids = 0;
    size_t anywhere = 0;
    size_t somewhere = 0;
    for (size_t i = 0; i < treatments_.size(); ++i) {
      if (treatments_[i] == LightTreatment::left_out) continue;
      ++grids;
      if (obstacles[i].anywhere()) ++anywhere;
      if (!obstacles[i].anywhere() && !obstacles[i].nowhere()) ++somewhere;
    }
    std::string reason = never;
    if (grids == 0) {
      reason = "no light has a term of its own";
    } else if (anywhere + somewhere > 0) {
      reason = what + " come between a point and " + std::to_string(anywhere + somewhere) + " of " +
               count_of(grids, "light");
      if (somewhere > 0)
        reason += "; " + std::to_string(somewhere) + " of these " + (somewhere == 1 ? "is" : "are") +
                  " free from all points on the inner side of flat walls, where this is left out";
    }
    const bool on = anywhere + somewhere > 0 || (force_ && grids > 0);
    if (on && anywhere + somewhere == 0) reason = "leaving out is switched off, although " + reason;
    terms_.push_back({term, on, reason});
  };
  describe("bisection", occluders_, "surfaces may", "nothing can come between a light and a point");
  describe("boundary crossings", passing_, "surfaces that light passes may",
           "no surface that light passes can be between a light and a point: one exponential each");
}

}  // namespace fogbank::transport
