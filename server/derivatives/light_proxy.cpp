#include "derivatives/light_proxy.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "derivatives/transmittance_jet.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {

namespace {

/// Pieces are at most this wide in optical units, up to this many a side (ratio-records.md section 1).
constexpr float piece_width = 0.5f;
constexpr float most_pieces = 8;
/// Corners of the polygon that stands for a disk: that of a light grid of 8 x 8 cells.
constexpr int disk_corners = 32;
constexpr float rounding = 1e-3f;

const scene::Texture* constant_radiance(const transport::LightShape& shape) {
  const scene::Texture* texture = std::visit(
      []<typename Shape>(const Shape& s) -> const scene::Texture* {
        if constexpr (requires { s.radiance->is_constant(); }) return s.radiance;
        return nullptr;
      },
      shape);
  return texture != nullptr && texture->is_constant() ? texture : nullptr;
}

/// Do all primitives of the light's shape belong to it? The many lights of a mesh are gathered together
/// (light_grid.h).
bool stands_alone(const transport::World& world, uint32_t light) {
  const scene::Scene& scene = world.scene();
  for (uint32_t s = 0; s < scene.shapes.size(); ++s) {
    const scene::Shape& shape = scene.shapes[s];
    if (shape.emitter == scene::none || shape.kind != scene::ShapeKind::triangle_mesh) continue;
    const size_t count = scene.meshes[static_cast<size_t>(shape.mesh)].triangles.size();
    size_t own = 0;
    for (uint32_t p = 0; p < count; ++p) own += world.light_of_hit(s, p) == light ? 1 : 0;
    if (own > 0) return own == count;
  }
  return true;
}

/// Solid angle / 4 pi of a convex flat polygon in front of the point: the argument of the product of what Van
/// Oosterom and Strackee (1983) give for a fan of triangles (method.md section 4.1). `normal` towards the
/// point, `height` above the plane, `fan_areas` twice the triangles' areas.
float polygon_form_factor(const std::vector<Vec3f>& vertices, const Vec3f& normal, const Vec3f& x) {
  const Vec3f first = vertices[0] - x;
  const float height = -glm::dot(first, normal);
  if (!(height > 0)) return 0;
  const float length = glm::length(first);
  std::complex<float> product(1, 0);
  Vec3f previous = vertices[1] - x;
  float previous_length = glm::length(previous);
  for (size_t i = 2; i < vertices.size(); ++i) {
    const Vec3f next = vertices[i] - x;
    const float next_length = glm::length(next);
    const float twice_area =
        glm::dot(glm::cross(vertices[i - 1] - vertices[0], vertices[i] - vertices[0]), normal);
    const float scale = 1 / (length * previous_length * next_length);
    const float a = height * twice_area * scale;
    const float b = 1 + (glm::dot(first, previous) * next_length + glm::dot(previous, next) * length +
                         glm::dot(next, first) * previous_length) *
                            scale;
    product = {product.real() * b - product.imag() * a, product.real() * a + product.imag() * b};
    previous = next;
    previous_length = next_length;
  }
  return std::atan2(product.imag(), product.real()) * (std::numbers::inv_pi_v<float> / 2);
}

}  // namespace

std::optional<LightProxy> LightProxy::make(const transport::World& world, const transport::Plan& plan,
                                           uint32_t light, int32_t medium) {
  if (plan.treatment(light) != transport::LightTreatment::light_grid || !stands_alone(world, light))
    return std::nullopt;
  const transport::LightShape shape = world.lights().light(light).shape();
  const scene::Texture* radiance = constant_radiance(shape);
  if (radiance == nullptr) return std::nullopt;
  LightProxy proxy;
  proxy.radiance_ = radiance->evaluate(Vec2f(0));
  const transport::LightBounds& bounds = world.lights().light(light).bounds();
  if (medium != scene::none &&
      !plan.may_cross_boundaries(light, bounds.center + bounds.axis * (1e-3f * bounds.radius)))
    proxy.sigma_t_ = world.medium(medium).sigma_t;
  if (const auto* rectangle = std::get_if<transport::RectangleShape>(&shape)) {
    proxy.split_rectangle(*rectangle);
  } else if (const auto* disk = std::get_if<transport::DiskShape>(&shape)) {
    proxy.split_disk(*disk);
  } else if (const auto* triangle = std::get_if<transport::TriangleShape>(&shape)) {
    const auto& [a, b, c] = triangle->vertices;
    proxy.normal_ = glm::normalize(glm::cross(b - a, c - a));
    proxy.pieces_.push_back({{a, b, c}, (a + b + c) / 3.0f});
  } else if (const auto* sphere = std::get_if<transport::SphereShape>(&shape); sphere && !sphere->inwards) {
    proxy.ball_ = Ball{sphere->center, sphere->radius};
  } else {
    return std::nullopt;
  }
  float reach = 0;
  for (const Piece& piece : proxy.pieces_)
    for (const Vec3f& vertex : piece.vertices) reach = std::fmax(reach, glm::length(vertex - piece.center));
  proxy.greatest_ratio_ = std::exp(max_component(proxy.sigma_t_) * reach) * (1 + rounding);
  if (!(proxy.greatest_ratio_ <= most_ratio)) return std::nullopt;
  return proxy;
}

void LightProxy::split_rectangle(const transport::RectangleShape& shape) {
  normal_ = glm::normalize(glm::cross(shape.edge_x, shape.edge_y));
  const auto count = [&](const Vec3f& edge) {
    return static_cast<int>(
        std::clamp(std::ceil(max_component(sigma_t_) * glm::length(edge) / piece_width), 1.0f, most_pieces));
  };
  const int columns = count(shape.edge_x);
  const int rows = count(shape.edge_y);
  const Vec3f x = shape.edge_x / static_cast<float>(columns);
  const Vec3f y = shape.edge_y / static_cast<float>(rows);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const Vec3f corner = shape.corner + x * static_cast<float>(i) + y * static_cast<float>(j);
      pieces_.push_back({{corner, corner + x, corner + x + y, corner + y}, corner + 0.5f * (x + y)});
    }
  }
}

void LightProxy::split_disk(const transport::DiskShape& shape) {
  normal_ = shape.normal;
  Piece piece;
  piece.center = shape.center;
  // The regular polygon of the disk's area.
  const double step = 2 * std::numbers::pi / disk_corners;
  const double radius = std::sqrt(step / std::sin(step));
  for (int i = 0; i < disk_corners; ++i)
    piece.vertices.push_back(shape.center + shape.axis_x * static_cast<float>(radius * std::cos(i * step)) +
                             shape.axis_y * static_cast<float>(radius * std::sin(i * step)));
  if (glm::dot(glm::cross(shape.axis_x, shape.axis_y), normal_) < 0) std::ranges::reverse(piece.vertices);
  pieces_.push_back(std::move(piece));
}

Spectrum LightProxy::value(const Vec3f& x) const {
  Spectrum sum(0);
  if (ball_) {
    const float distance = glm::length(ball_->center - x);
    if (!(distance > ball_->radius)) return sum;
    const float sine = ball_->radius / distance;
    const float form_factor = 0.5f * sine * sine / (1 + std::sqrt((1 - sine) * (1 + sine)));
    sum = form_factor * transport::transmittance(sigma_t_, distance - ball_->radius);
  }
  for (const Piece& piece : pieces_)
    sum += polygon_form_factor(piece.vertices, normal_, x) *
           transport::transmittance(sigma_t_, glm::length(piece.center - x));
  return radiance_ * sum;
}

RadianceJet LightProxy::jet(const Vec3d& x, double least_distance) const {
  RadianceJet sum;
  const auto add = [&](const Jet3d& form_factor, const Jet3d& distance) {
    for (size_t c = 0; c < 3; ++c) {
      const int channel = static_cast<int>(c);
      sum.channels[c] += form_factor * transmittance_jet(static_cast<double>(sigma_t_[channel]), distance) *
                         static_cast<double>(radiance_[channel]);
    }
  };
  if (ball_) {
    const auto radius = static_cast<double>(ball_->radius);
    const Vec3d to_center = Vec3d(ball_->center) - x;
    if (!(glm::length(to_center) > radius)) return sum;
    const double d = std::max(glm::length(to_center), radius + least_distance);
    Jet3d distance = distance_jet<double, 3>(to_center);
    distance.value = d;
    // F = (1 - c) / 2 with c^2 = 1 - radius^2 / d^2.
    const double sine = radius / d;
    const double c = std::sqrt((1 - sine) * (1 + sine));
    const double slope = sine * sine / (d * c);
    const double curvature = -slope * (3 / d + slope / c);
    add(chain(distance, 0.5 * sine * sine / (1 + c), -0.5 * slope, -0.5 * curvature),
        distance + Jet3d::constant(-radius));
    return sum;
  }
  const Vec3d normal(normal_);
  for (const Piece& piece : pieces_) {
    Vec3d shift = -x;
    const double height = -glm::dot(Vec3d(piece.vertices[0]) - x, normal);
    if (!(height > 0)) return {};
    if (height < least_distance) shift -= normal * (least_distance - height);
    const Vec3d first = Vec3d(piece.vertices[0]) + shift;
    Jet3d form_factor;
    for (size_t i = 2; i < piece.vertices.size(); ++i)
      form_factor += triangle_form_factor_jet(RelativeTriangle<double>::from_relative(
          first, Vec3d(piece.vertices[i]) + shift, Vec3d(piece.vertices[i - 1]) + shift));
    add(form_factor, distance_jet<double, 3>(Vec3d(piece.center) + shift));
  }
  return sum;
}

}  // namespace fogbank::derivatives
