#include "scene/xml/transform.h"

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "scene/loader.h"
#include "scene/text.h"
#include "scene/xml/values.h"

namespace fogbank::scene {
namespace {

constexpr const char* reason = "INVALID_TRANSFORM";

[[noreturn]] void fail(const XmlElement& element, const std::string& message) {
  throw SceneError(ErrorKind::invalid_argument, reason, element.where, message);
}

Vec3d named_vector(const XmlElement& element, const char* attribute) {
  const std::string* text = element.find(attribute);
  if (!text) fail(element, std::string("attribute '") + attribute + "' is missing");
  const auto numbers = parse_numbers(*text);
  if (!numbers || numbers->size() != 3)
    fail(element, std::string("attribute '") + attribute + "' must be three numbers, is " + quote(*text));
  return {(*numbers)[0], (*numbers)[1], (*numbers)[2]};
}

double length_of(const Vec3d& v) { return std::sqrt(glm::dot(v, v)); }

/// Camera-to-world matrix with columns left, up, view direction, origin.
Mat4d look_at(const XmlElement& element) {
  const Vec3d origin = named_vector(element, "origin");
  const Vec3d target = named_vector(element, "target");
  const Vec3d up = element.find("up") ? named_vector(element, "up") : Vec3d(0, 1, 0);
  const Vec3d view = target - origin;
  if (!(length_of(view) > 0) || !std::isfinite(length_of(view)))
    fail(element, "'origin' and 'target' coincide");
  const Vec3d direction = glm::normalize(view);
  const Vec3d left = glm::cross(up, direction);
  // An `up` this close to the view direction leaves no digits for the camera's roll.
  if (!(length_of(left) > 1e-10 * length_of(up))) fail(element, "'up' is parallel to the view direction");
  const Vec3d unit_left = glm::normalize(left);
  return {glm::dvec4(unit_left, 0), glm::dvec4(glm::cross(direction, unit_left), 0), glm::dvec4(direction, 0),
          glm::dvec4(origin, 1)};
}

Mat4d matrix(const XmlElement& element) {
  const auto numbers = parse_numbers(element.get("value"));
  if (!numbers || (numbers->size() != 16 && numbers->size() != 9))
    fail(element, "'value' must be 16 or 9 numbers, is " + quote(element.get("value")));
  const int side = numbers->size() == 16 ? 4 : 3;
  Mat4d result(1.0);
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column)
      result[column][row] = (*numbers)[static_cast<size_t>(row * side + column)];
  return result;
}

Mat4d rotation(const XmlElement& element) {
  const Vec3d axis = read_vector(element, 0.0);
  if (!(length_of(axis) > 0)) fail(element, "the rotation has no axis: give x, y, z or value");
  const std::optional<double> angle = parse_number(element.get("angle"));
  if (!angle) fail(element, "'angle' must be a number of degrees, is " + quote(element.get("angle")));
  return glm::rotate(Mat4d(1.0), glm::radians(*angle), glm::normalize(axis));
}

Mat4d step_matrix(const XmlElement& step) {
  if (step.tag == "translate") return glm::translate(Mat4d(1.0), read_vector(step, 0.0));
  if (step.tag == "scale") return glm::scale(Mat4d(1.0), read_vector(step, 1.0));
  if (step.tag == "rotate") return rotation(step);
  if (step.tag == "lookat") return look_at(step);
  if (step.tag == "matrix") return matrix(step);
  throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_ELEMENT", step.where,
                   "is no transform step; supported: lookat, matrix, rotate, scale, translate");
}

void check(const XmlElement& element, const Mat4d& m) {
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row)
      if (!(std::abs(m[column][row]) <= LoadLimits::coordinate))
        fail(element,
             "the matrix has numbers that are not finite or above " + number_text(LoadLimits::coordinate));
  if (m[0][3] != 0 || m[1][3] != 0 || m[2][3] != 0 || m[3][3] != 1)
    fail(element, "the matrix is projective: its last row must be 0 0 0 1");
  // |det| over the product of the columns' lengths is 1 for any scaled rotation, however small its scale, and
  // 0 when the columns lie in a plane; below 1e-9 a float normal has no digits left.
  const glm::dmat3 linear(m);
  const double volume = length_of(linear[0]) * length_of(linear[1]) * length_of(linear[2]);
  if (!(std::abs(glm::determinant(linear)) > 1e-9 * volume)) fail(element, "the matrix is singular");
}

}  // namespace

Vec3d read_vector(const XmlElement& element, double fallback) {
  const auto bad = [&](const std::string& message) {
    throw SceneError(ErrorKind::invalid_argument, "INVALID_VALUE", element.where, message);
  };
  Vec3d result(fallback);
  if (const std::string* value = element.find("value")) {
    const auto numbers = parse_numbers(*value);
    if (!numbers || (numbers->size() != 1 && numbers->size() != 3))
      bad("'value' must be one or three numbers, is " + quote(*value));
    else
      result =
          numbers->size() == 1 ? Vec3d((*numbers)[0]) : Vec3d((*numbers)[0], (*numbers)[1], (*numbers)[2]);
  }
  constexpr const char* axes[] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis)
    if (const std::string* text = element.find(axes[axis])) {
      if (element.find("value")) bad(std::string("'value' and '") + axes[axis] + "' exclude each other");
      const std::optional<double> number = parse_number(*text);
      if (!number) bad(std::string("'") + axes[axis] + "' must be a number, is " + quote(*text));
      result[axis] = number.value_or(fallback);
    }
  return result;
}

Mat4d read_transform(const XmlElement& transform) {
  Mat4d result(1.0);
  for (const XmlElement& step : transform.children) result = step_matrix(step) * result;
  check(transform, result);
  return result;
}

}  // namespace fogbank::scene
