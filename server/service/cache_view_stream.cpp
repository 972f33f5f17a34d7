#include "service/cache_view_stream.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "cache/extents.h"
#include "cache/index.h"
#include "core/error.h"
#include "integrators/integrator.h"
#include "render/film_camera.h"
#include "render/plan_view.h"
#include "render/progression.h"
#include "scene/intersector.h"
#include "service/answers.h"
#include "service/cache_messages.h"
#include "service/field_errors.h"
#include "service/job_settings.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

/// Of one message: 12 floats a place, 9 bytes a pixel, so that messages stay far below gRPC's 4 MiB.
constexpr uint32_t places_per_message = 2000;
constexpr int32_t pixels_per_message = 1 << 16;

/// The records as a job with these settings would see them, none added.
std::shared_ptr<const cache::Epoch> publish(const std::shared_ptr<const transport::World>& world,
                                            render::RenderSettings settings) {
  settings.integrator_settings.most_records = 0;
  const auto integrator =
      integrators::make_integrator(settings.integrator, world, settings.integrator_settings);
  const render::FilmCamera camera(settings.sensor, settings.film);
  const auto preparation = integrator->prepare(camera, {.error = render::cache_error(settings)});
  scene::prepare_render_thread();
  while (preparation && !integrator->epoch()) {
    const uint32_t tasks = preparation->next_round();
    if (tasks == 0) break;
    RayCounters counters;
    for (uint32_t task = 0; task < tasks && !integrator->epoch(); ++task) preparation->run(task, counters);
  }
  return integrator->epoch();
}

void describe(v1::PlanView& message, const render::PlanView& view) {
  message.set_width(view.width);
  message.set_height(view.height);
  message.set_right_axis(view.right_axis);
  message.set_down_axis(view.down_axis);
  message.set_up_axis(view.up_axis);
  message.set_left(view.left);
  message.set_top(view.top);
  message.set_pixel_size(view.pixel_size);
  message.set_cut(view.cut);
}

void add_row(v1::PlanRows& message, const render::PlanView& view, int32_t row) {
  const auto begin = static_cast<size_t>(row) * static_cast<size_t>(view.width);
  for (size_t i = begin; i < begin + static_cast<size_t>(view.width); ++i) {
    message.add_depth(view.depth[i]);
    message.add_facing(view.facing[i]);
    message.mutable_solid()->push_back(static_cast<char>(view.solid[i]));
  }
}

/// Positions of the records in media, one of each place: what lies in free space.
std::vector<Vec3f> places_in_media(const cache::RecordSet& set) {
  std::vector<Vec3f> places;
  for (const cache::ComponentRange& range : set.components()) {
    if (range.component.quantity == cache::Quantity::irradiance) continue;
    for (uint32_t i = 0; i < range.place_count; ++i) places.push_back(set.place(range, i).position);
  }
  return places;
}

void add_place(v1::RecordExtents& message, const cache::Place& place, const cache::Ellipsoid& ellipsoid) {
  for (int k = 0; k < 3; ++k) message.add_positions(place.position[k]);
  std::array<float, 3> lengths = ellipsoid.semi_axes;
  if (place.normal != Vec3f(0)) lengths[2] = 0;  // across the surface
  std::array<size_t, 3> order{0, 1, 2};
  std::ranges::stable_sort(order, std::ranges::greater{}, [&](size_t axis) { return lengths[axis]; });
  for (const size_t axis : order) {
    for (int k = 0; k < 3; ++k) message.add_semi_axes(lengths[axis] * ellipsoid.axes[axis][k]);
  }
}

class ViewStream final : public grpc::ServerWriteReactor<v1::ViewCacheResponse> {
 public:
  ViewStream(const v1::ViewCacheRequest& request, SceneRegistry& scenes, CacheRegistry& caches,
             TaskQueue& queue)
      : request_(request), scenes_(scenes), caches_(caches), queue_(queue) {
    post([this] { acquire(); });
  }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      Finish(grpc::Status::CANCELLED);
    } else {
      post([this] { next_row_ < view_.height ? send_rows() : send_places(); });
    }
  }

  void OnDone() override { delete this; }

 private:
  template <typename Work>
  void post(const Work& work) {
    const bool posted = queue_.post([this, work] {
      try {
        work();
      } catch (...) {
        Finish(status_of(std::current_exception()));
      }
    });
    if (!posted) Finish(shutting_down_status());
  }

  void acquire() {
    scenes_.acquire(parse_scene_name(request_.scene()), [this](std::shared_ptr<const transport::World> world,
                                                               double, const std::exception_ptr& error) {
      if (error) {
        Finish(status_of(error));
      } else {
        post([this, world = std::move(world)] { send_plan(world); });
      }
    });
  }

  void send_plan(const std::shared_ptr<const transport::World>& world) {
    if (request_.side() < 0 || request_.side() > limits::max_view_side) {
      refuse_view("side", "must be 1 to " + std::to_string(limits::max_view_side));
    }
    render::RenderSettings settings = resolve_settings(request_.settings(), world->scene(), 1).engine;
    if (!uses_cache(settings.integrator))
      refuse_field("settings.integrator", "\"" + settings.integrator + "\" has no cache to view");
    const int32_t max_depth = settings.integrator_settings.max_depth;
    set_ = caches_.acquire(cache::record_field(world->scene(), max_depth))->records();
    settings.integrator_settings.cache = std::make_shared<cache::SceneCache>(set_);
    epoch_ = publish(world, settings);
    render::PlanRequest plan;
    plan.side = request_.side() > 0 ? request_.side() : static_cast<int32_t>(limits::default_view_side);
    if (request_.has_cut()) plan.cut = request_.cut();
    if (request_.has_up_axis()) plan.up_axis = request_.up_axis();
    try {
      view_ = render::plan_view(world->scene(), places_in_media(*set_), plan);
    } catch (const Error& error) {
      const EngineFieldError parts(error);
      refuse_view(parts.field, parts.message);
    }
    describe(*response_.mutable_plan(), view_);
    StartWrite(&response_);
  }

  void send_rows() {
    v1::PlanRows& message = *response_.mutable_rows();
    message.Clear();
    const int32_t count = std::max(1, pixels_per_message / view_.width);
    const int32_t end = std::min(next_row_ + count, view_.height);
    for (; next_row_ < end; ++next_row_) add_row(message, view_, next_row_);
    StartWrite(&response_);
  }

  /// The next places of the component, or of the next one that has some.
  void send_places() {
    while (epoch_ && component_ < set_->components().size()) {
      const cache::ComponentRange& range = set_->components()[component_];
      if (next_place_ == 0) ellipsoids_ = cache::guarded_ellipsoids(*set_, range, epoch_->settings());
      if (next_place_ >= range.place_count) {
        ++component_;
        next_place_ = 0;
        continue;
      }
      const uint32_t end = std::min(next_place_ + places_per_message, range.place_count);
      v1::RecordExtents& message = *response_.mutable_records();
      message.Clear();
      *message.mutable_component() = to_message(range);
      message.set_places(range.place_count);
      for (; next_place_ < end; ++next_place_)
        add_place(message, set_->place(range, next_place_), ellipsoids_[next_place_]);
      StartWrite(&response_);
      return;
    }
    Finish(grpc::Status::OK);
  }

  [[noreturn]] static void refuse_view(const std::string& field, const std::string& message) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_VIEW", field + ": " + message,
                   {{"field", field}});
  }

  const v1::ViewCacheRequest request_;
  SceneRegistry& scenes_;
  CacheRegistry& caches_;
  TaskQueue& queue_;
  std::shared_ptr<const cache::RecordSet> set_;
  std::shared_ptr<const cache::Epoch> epoch_;
  render::PlanView view_;
  int32_t next_row_ = 0;
  std::vector<cache::Ellipsoid> ellipsoids_;  ///< of the present component
  size_t component_ = 0;
  uint32_t next_place_ = 0;
  v1::ViewCacheResponse response_;
};

}  // namespace

grpc::ServerWriteReactor<v1::ViewCacheResponse>* start_view(const v1::ViewCacheRequest& request,
                                                            SceneRegistry& scenes, CacheRegistry& caches,
                                                            TaskQueue& queue) {
  return new ViewStream(request, scenes, caches, queue);
}

}  // namespace fogbank::service
