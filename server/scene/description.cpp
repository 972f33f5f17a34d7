#include "scene/description.h"

#include <algorithm>
#include <cmath>

#include "scene/text.h"

namespace fogbank::scene {
namespace {

const char* kind_name(const PropertyValue& value) {
  switch (value.index()) {
    case 0:
      return "a boolean";
    case 1:
      return "an integer";
    case 2:
      return "a float";
    case 3:
      return "a string";
    case 4:
      return "a point or vector";
    case 5:
      return "an rgb or spectrum";
    case 6:
      return "a transform";
    default:
      return "a nested object";
  }
}

/// Number in `value`, if it is one: an old file may write a scalar as a grey `<spectrum>`.
std::optional<double> as_number(const PropertyValue& value) {
  if (const auto* number = std::get_if<double>(&value)) return *number;
  if (const auto* number = std::get_if<int64_t>(&value)) return static_cast<double>(*number);
  if (const auto* colour = std::get_if<Spectrum>(&value))
    if (colour->x == colour->y && colour->y == colour->z) return colour->x;
  return std::nullopt;
}

std::string range_text(double lowest, double highest) {
  const bool bounded_below = std::isfinite(lowest) && lowest != -std::numeric_limits<float>::max();
  const bool bounded_above = std::isfinite(highest) && highest != std::numeric_limits<float>::max();
  if (bounded_below && bounded_above)
    return "must lie in [" + number_text(lowest) + ", " + number_text(highest) + "]";
  if (bounded_below) return "must be at least " + number_text(lowest);
  if (bounded_above) return "must be at most " + number_text(highest);
  return "must be finite";
}

}  // namespace

const Property* ObjectDescription::find(std::string_view name) const {
  for (const Property& property : properties)
    if (property.name == name) return &property;
  return nullptr;
}

PropertyReader::PropertyReader(const ObjectDescription& object)
    : object_(object), used_(object.properties.size(), false) {}

const Property* PropertyReader::take(std::string_view name) {
  known_.emplace(name);
  for (size_t i = 0; i < object_.properties.size(); ++i)
    if (object_.properties[i].name == name) {
      used_[i] = true;
      return &object_.properties[i];
    }
  return nullptr;
}

bool PropertyReader::has(std::string_view name) const { return object_.find(name) != nullptr; }

bool PropertyReader::boolean(std::string_view name, bool fallback) {
  const Property* property = take(name);
  if (!property) return fallback;
  if (const bool* value = std::get_if<bool>(&property->value)) return *value;
  fail_at(name, "WRONG_TYPE", std::string("must be a boolean, is ") + kind_name(property->value));
}

int64_t PropertyReader::integer(std::string_view name, int64_t fallback, int64_t lowest, int64_t highest) {
  const Property* property = take(name);
  if (!property) return fallback;
  const int64_t* value = std::get_if<int64_t>(&property->value);
  if (!value)
    fail_at(name, "WRONG_TYPE", std::string("must be an integer, is ") + kind_name(property->value));
  if (*value < lowest || *value > highest)
    fail_at(name, "OUT_OF_RANGE",
            "must lie in [" + std::to_string(lowest) + ", " + std::to_string(highest) + "], is " +
                std::to_string(*value));
  return *value;
}

std::optional<double> PropertyReader::number_if_given(std::string_view name, double lowest, double highest) {
  const Property* property = take(name);
  if (!property) return std::nullopt;
  const std::optional<double> value = as_number(property->value);
  if (!value) fail_at(name, "WRONG_TYPE", std::string("must be a float, is ") + kind_name(property->value));
  if (!std::isfinite(*value)) fail_at(name, "NOT_FINITE", "must be finite, is " + number_text(*value));
  if (*value < lowest || *value > highest)
    fail_at(name, "OUT_OF_RANGE", range_text(lowest, highest) + ", is " + number_text(*value));
  return value;
}

double PropertyReader::number(std::string_view name, double fallback, double lowest, double highest) {
  return number_if_given(name, lowest, highest).value_or(fallback);
}

std::string PropertyReader::text(std::string_view name, const std::string& fallback) {
  const Property* property = take(name);
  if (!property) return fallback;
  if (const auto* value = std::get_if<std::string>(&property->value)) return *value;
  fail_at(name, "WRONG_TYPE", std::string("must be a string, is ") + kind_name(property->value));
}

std::string PropertyReader::choice(std::string_view name, const std::string& fallback,
                                   const std::vector<std::string>& choices) {
  std::string value = text(name, fallback);
  if (value != fallback && std::find(choices.begin(), choices.end(), value) == choices.end())
    fail_at(
        name, "UNKNOWN_CHOICE",
        quote(value) + " is not supported; supported: " + list_names(choices) + did_you_mean(value, choices));
  return value;
}

Vec3d PropertyReader::vector(std::string_view name, const Vec3d& fallback) {
  const Property* property = take(name);
  if (!property) return fallback;
  const Vec3d* value = std::get_if<Vec3d>(&property->value);
  if (!value)
    fail_at(name, "WRONG_TYPE", std::string("must be a point or vector, is ") + kind_name(property->value));
  if (!std::isfinite(value->x) || !std::isfinite(value->y) || !std::isfinite(value->z))
    fail_at(name, "NOT_FINITE", "must be finite");
  return *value;
}

Spectrum PropertyReader::spectrum(std::string_view name, const Spectrum& fallback, float lowest,
                                  float highest) {
  const Property* property = take(name);
  if (!property) return fallback;
  Spectrum value(0);
  if (const auto* colour = std::get_if<Spectrum>(&property->value))
    value = *colour;
  else if (const std::optional<double> number = as_number(property->value))
    value = Spectrum(static_cast<float>(*number));
  else
    fail_at(name, "WRONG_TYPE", std::string("must be an rgb or spectrum, is ") + kind_name(property->value));
  for (int channel = 0; channel < 3; ++channel) {
    if (!std::isfinite(value[channel]))
      fail_at(name, "NOT_FINITE", "must be finite, is " + number_text(value[channel]));
    if (value[channel] < lowest || value[channel] > highest)
      fail_at(name, "OUT_OF_RANGE", range_text(lowest, highest) + ", is " + number_text(value[channel]));
  }
  return value;
}

Mat4d PropertyReader::transform(std::string_view name) {
  const Property* property = take(name);
  if (!property) return Mat4d(1.0);
  if (const auto* value = std::get_if<Mat4d>(&property->value)) return *value;
  fail_at(name, "WRONG_TYPE", std::string("must be a transform, is ") + kind_name(property->value));
}

ObjectPointer PropertyReader::child(std::string_view name, std::string_view tag) {
  const Property* property = take(name);
  if (!property) return nullptr;
  const auto* value = std::get_if<ObjectPointer>(&property->value);
  if (!value || (*value)->tag != tag)
    fail_at(name, "WRONG_TYPE",
            "must be a <" + std::string(tag) + ">, is " +
                (value ? "a <" + (*value)->tag + ">" : std::string(kind_name(property->value))));
  return *value;
}

std::vector<ObjectPointer> PropertyReader::children(std::string_view tag) {
  known_.insert("<" + std::string(tag) + ">");
  std::vector<ObjectPointer> found;
  for (size_t i = 0; i < object_.properties.size(); ++i) {
    const auto* value = std::get_if<ObjectPointer>(&object_.properties[i].value);
    if (!value || (*value)->tag != tag) continue;
    used_[i] = true;
    found.push_back(*value);
  }
  return found;
}

const PropertyValue* PropertyReader::raw(std::string_view name) {
  const Property* property = take(name);
  return property ? &property->value : nullptr;
}

void PropertyReader::fail(const std::string& reason, const std::string& message) const {
  throw SceneError(ErrorKind::invalid_argument, reason, object_.where, message);
}

void PropertyReader::fail_at(std::string_view property, const std::string& reason,
                             const std::string& message) const {
  SourceLocation where = object_.where;
  if (const Property* found = object_.find(property); found && found->where.line > 0) {
    where.file = found->where.file;
    where.line = found->where.line;
  }
  throw SceneError(ErrorKind::invalid_argument, reason, where,
                   "parameter " + quote(property) + ": " + message);
}

void PropertyReader::finish(std::vector<std::string>* warnings) {
  std::vector<std::string> known;
  for (const std::string& name : known_)
    if (!name.empty()) known.push_back(name);
  for (size_t i = 0; i < used_.size(); ++i) {
    if (used_[i]) continue;
    const Property& property = object_.properties[i];
    const auto* nested = std::get_if<ObjectPointer>(&property.value);
    const std::string what = property.name.empty() && nested ? "unexpected " + (*nested)->where.element
                                                             : "unknown parameter " + quote(property.name);
    SourceLocation where = object_.where;
    if (property.where.line > 0) {
      where.file = property.where.file;
      where.line = property.where.line;
    }
    if (warnings) {
      warnings->push_back(where.to_string() + ": " + what + " is ignored");
      continue;
    }
    throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_PARAMETER", where,
                     what + "; supported: " + (known.empty() ? "none" : list_names(known)) +
                         did_you_mean(property.name, known));
  }
}

}  // namespace fogbank::scene
