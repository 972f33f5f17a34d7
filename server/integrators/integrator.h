// The interface of integrators: radiance along a camera ray. One file per integrator, one line in
// integrator_registry.cpp.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/random.h"
#include "core/ray_counters.h"
#include "core/vector.h"
#include "scene/sensor.h"

namespace fogbank::cache {
class Epoch;
class SceneCache;
}  // namespace fogbank::cache
namespace fogbank::transport {
class World;
}

namespace fogbank::integrators {

/// How single scattering from lights of finite size gets into the picture (ratio-records.md).
enum class SingleScattering : uint8_t {
  automatic,  ///< by predicted cost, as the plan says
  direct,     ///< sampled by the unoccluded proxy: unbiased
  cached,     ///< proxy times cached ratio, where a light has one
};

struct IntegratorSettings {
  int32_t max_depth =
      -1;  ///< path length in edges, as Mitsuba's: 1 = emitted light only, 2 = one bounce; -1 = unbounded
  int32_t rr_depth = 2;  ///< Russian roulette by throughput from this depth on
  bool hide_emitters = false;
  /// That camera rays start in, scene::none for vacuum; nothing: that of the scene file's camera.
  std::optional<int32_t> camera_medium = std::nullopt;
  // Of methods with a cache:
  SingleScattering single_scattering = SingleScattering::automatic;
  int64_t most_records = int64_t{1} << 24;  ///< that one job makes; 0: it only reads those that are there
  bool spheres = false;                     ///< isotropic extents instead of ellipsoids
  double minimum_radius = 0;  ///< of extents, scene units: none is smaller, whatever its error; >= 0
  /// What decisions by predicted cost reckon with: camera samples of the picture, of all its pixels, and
  /// the relative error that is wanted.
  int64_t expected_samples = int64_t{1} << 20;
  double expected_error = 0.02;
  /// The scene's records, shared with other jobs; null: the integrator keeps its own.
  std::shared_ptr<cache::SceneCache> cache = nullptr;
};

/// What an integrator settled for a picture, for people.
struct Decision {
  std::string what;    ///< e.g. "ratio records of \"lamp\""
  bool on = false;     ///< whether it is done
  std::string reason;  ///< a sentence without its full stop
};

/// One sample of a pixel, linear sRGB; all parts finite and >= 0.
struct PixelSample {
  Spectrum sampled{0};  ///< depends on random numbers only: all samples of a job count
  Spectrum cached{0};   ///< depends on the cache's epoch: replaced when the next one is published
  /// `sampled` as it would have been with half the radius of everything that blurs; of Integrator::blurs.
  Spectrum narrow{0};
};

/// What the cache says along a camera ray, for AOVs and error estimates; means over the look-ups, weighted by
/// what each contributes to the pixel.
struct CacheView {
  float radius = 0;          ///< harmonic mean of the semi-axes of extents, scene units
  float record_density = 0;  ///< records that count per look-up
  float rejected = 0;        ///< records that a surface hides (guard 4) per look-up
  float variance = 0;        ///< of the pixel's luminance, from the records' own
  float bias = 0;            ///< of the pixel's luminance: extrapolation error as the metric bounds it
};

/// The camera of the image that is to be made, for whoever prepares it.
class CameraRays {
 public:
  virtual ~CameraRays() = default;
  /// A ray through film pixel (x, y): the place in the pixel and on the lens is drawn from `random`.
  virtual Ray sample(uint32_t x, uint32_t y, RandomStream& random) const = 0;
  virtual scene::Window window() const = 0;  ///< pixels that are wanted
  virtual Vec2i film_size() const = 0;       ///< pixels of the whole film, of which `window` is a part
  virtual Vec3f position() const = 0;
  virtual float pixel_angle() const = 0;  ///< radians that a pixel spans in the middle; 0: orthographic
};

/// How good the cache is to be.
struct CacheTarget {
  double error = 0.02;   ///< relative error of the cached part of a pixel, about; 1e-6 to 10
  bool preview = false;  ///< the first picture is awaited: the fewest records that show something
};

struct CacheCounts {
  uint64_t records_reused = 0;  ///< in the set when the job began, of components that it uses
  uint64_t records_new = 0;     ///< made by this job
  uint64_t epoch = 0;           ///< of the cache, as last published
};

/// Work to be done before passes: rounds of independent tasks. The result depends on the rounds and tasks,
/// not on who ran them. One that is destroyed before `next_round` gave 0 (no time was left for it) leaves
/// `Integrator::sample` as the last finished preparation left it, or, if there was none, with whatever was
/// published; the records it made stay in the cache.
class Preparation {
 public:
  virtual ~Preparation() = default;
  /// Ends the round before and plans the next: its number of tasks, 0 when all is prepared. Called by one
  /// thread at a time, while no task and no pass runs; so are `fraction` and the destructor.
  virtual uint32_t next_round() = 0;
  /// Task of the present round, 0 <= task < the number given. Any thread; a task may be run again, with the
  /// same result, if it threw Interrupted.
  virtual void run(uint32_t task, RayCounters& counters) = 0;
  /// Share of the whole preparation that is done, about; 0 to 1.
  virtual double fraction() const = 0;
  /// Of the present round, below 16: tasks of rounds of the same kind take about as long. Called as
  /// `fraction`.
  virtual uint32_t round_kind() const { return 0; }

  // Of `Integrator::prepare`, for several processes that go through the same rounds together. One of them
  // collects the results of tasks that others ran, and tells all what came of each round: then all of them
  // plan the same next round, and publish the same. The bytes are those of this build; who reads them checks
  // every length and number, and throws Error(invalid_argument, "POISONED_RESULT") where they make no sense.
  // A preparation that doesn't know how throws Error(unsupported, "NOT_SHARED").

  /// What `run` brought, after it.
  virtual std::string result(uint32_t task) const;
  /// In place of `run`, with what `result` gave elsewhere. Any thread, each task once at a time.
  virtual void accept(uint32_t task, std::string_view result);
  /// What the round brought, as far as its tasks are done; `next_round` or the destructor follows.
  virtual std::string outcome();
  /// In place of the round's tasks, with what `outcome` gave elsewhere; `next_round` or the destructor
  /// follows.
  virtual void adopt(std::string_view outcome);
};

/// What one pass takes of every pixel: samples [first, first + count).
struct PassSamples {
  uint64_t seed = 0;
  uint32_t first = 0;
  uint32_t count = 0;
};

/// One instance serves all threads; `sample` sees what the last finished preparation published.
class Integrator {
 public:
  virtual ~Integrator() = default;
  /// One sample of the radiance that arrives along `ray`. Draws only from `random`.
  virtual PixelSample sample(const Ray& ray, RandomStream& random, RayCounters& counters) const = 0;
  /// The same, of which nobody wants `PixelSample::cached`.
  virtual PixelSample sample_without_cache(const Ray& ray, RandomStream& random,
                                           RayCounters& counters) const {
    return sample(ray, random, counters);
  }
  /// What must be done before `sample` may be asked for a picture as good as `target`; null: nothing. Targets
  /// of one job get finer. `camera` and the integrator must outlive the answer.
  virtual std::unique_ptr<Preparation> prepare(const CameraRays& /*camera*/, const CacheTarget& /*target*/) {
    return nullptr;
  }
  /// Do samples look around by a radius that falls with their number, so that their mean is off by something
  /// that falls, too? What it is off by is estimated from PixelSample::narrow.
  virtual bool blurs() const { return false; }
  /// Samples of a pixel that one pass may take.
  virtual uint32_t most_samples_of_pass() const { return std::numeric_limits<uint32_t>::max(); }
  /// Does `prepare_pass` ever give anything?
  virtual bool prepares_passes() const { return false; }
  /// What must be done before `sample` may be asked for these samples, and for no others; null: nothing.
  /// A sample depends on its number, not on the pass that it is in. `camera` as above.
  virtual std::unique_ptr<Preparation> prepare_pass(const CameraRays& /*camera*/,
                                                    const PassSamples& /*samples*/) {
    return nullptr;
  }
  /// While no task and no pass runs.
  virtual CacheCounts cache_counts() const { return {}; }
  /// Of the first preparation; while no task and no pass runs.
  virtual std::vector<Decision> decisions() const { return {}; }
  /// What the finished preparations left besides the cache's records, for `restore` of a new integrator of
  /// the same build; while no task and no pass runs. None where there is nothing yet, or it can't be
  /// restored.
  virtual std::optional<std::string> state() const { return std::nullopt; }
  /// In place of the preparations after which `state` was taken, with a cache that holds the records of the
  /// epoch that was published then and no others: that epoch is published, and what follows is as it would
  /// have been. Before anything is prepared. `camera` as above. Throws Error(invalid_argument,
  /// "POISONED_RESULT") for bytes that make no sense; unsupported "NOT_RESTORED" where `state` gives nothing.
  virtual void restore(const CameraRays& camera, std::string_view state);
  /// As last published; null: none yet, or no cache.
  virtual std::shared_ptr<const cache::Epoch> epoch() const { return nullptr; }
  virtual CacheView cache_view(const Ray& /*ray*/, RandomStream& /*random*/,
                               RayCounters& /*counters*/) const {
    return {};
  }
};

/// Throws Error(invalid_argument, "UNKNOWN_INTEGRATOR") naming the known ones.
std::unique_ptr<Integrator> make_integrator(const std::string& name,
                                            std::shared_ptr<const transport::World> world,
                                            const IntegratorSettings& settings);

struct IntegratorInfo {
  std::string name;
  std::string summary;
  bool cached = false;             ///< reads and fills IntegratorSettings::cache
  bool single_scattering = false;  ///< IntegratorSettings::single_scattering is its to obey
};
std::vector<IntegratorInfo> supported_integrators();

}  // namespace fogbank::integrators
