#include "scene/xml/upgrade.h"

#include <algorithm>
#include <array>
#include <set>

#include "scene/text.h"

namespace fogbank::scene {
namespace {

bool is_lower(char c) { return c >= 'a' && c <= 'z'; }
bool is_upper(char c) { return c >= 'A' && c <= 'Z'; }

XmlElement* find_child(XmlElement& element, std::string_view name) {
  for (XmlElement& child : element.children)
    if (child.get("name") == name) return &child;
  return nullptr;
}

void drop_children(XmlElement& element, const std::set<std::string_view>& names) {
  std::erase_if(element.children,
                [&](const XmlElement& child) { return names.count(child.get("name")) > 0; });
}

/// `uoffset`, `voffset`, `uscale` and `vscale` to the transform that Mitsuba 3 wants: scale, then offset.
void upgrade_texture_placement(XmlElement& element) {
  constexpr std::array<const char*, 4> names = {"uscale", "vscale", "uoffset", "voffset"};
  std::array<std::string, 4> values = {"1", "1", "0", "0"};
  bool is_given = false;
  SourceLocation where = element.where;
  for (size_t i = 0; i < names.size(); ++i)
    if (const XmlElement* child = find_child(element, names[i])) {
      values[i] = child->get("value");
      where = child->where;
      is_given = true;
    }
  if (!is_given) return;
  drop_children(element, {names.begin(), names.end()});
  const auto step = [&](const char* tag, const std::string& x, const std::string& y) {
    XmlElement made{tag, {{"x", x}, {"y", y}}, {}, where, true};
    made.update_label();
    return made;
  };
  XmlElement transform{"transform", {{"name", "to_uv"}}, {}, where, true};
  transform.children = {step("scale", values[0], values[1]), step("translate", values[2], values[3])};
  transform.update_label();
  element.children.push_back(std::move(transform));
}

/// A parameter of 0.x that Mitsuba 3 doesn't have; "" for any type.
struct Dropped {
  std::string_view tag;
  std::string_view type;
  std::string_view name;
  const char* consequence;
};
constexpr Dropped dropped[] = {
    {"bsdf", "conductor", "ext_eta", "the outside is taken as air"},
    {"bsdf", "roughconductor", "ext_eta", "the outside is taken as air"},
    {"texture", "bitmap", "cache", "it tunes an old version's memory use"},
    {"texture", "bitmap", "max_anisotropy", "textures are filtered bilinearly"},
    {"medium", "", "method", "it chooses an old version's sampling method"},
    {"medium", "", "step_size", "it chooses an old version's ray marching step"},
    {"medium", "homogeneous", "strategy", "it chooses an old version's sampling method"},
    {"medium", "homogeneous", "sampling_density", "it chooses an old version's sampling method"},
};

void drop_obsolete(XmlElement& element, std::vector<std::string>& warnings) {
  const std::string& type = element.get("type");
  for (const Dropped& entry : dropped) {
    if (element.tag != entry.tag || (!entry.type.empty() && type != entry.type)) continue;
    const XmlElement* child = find_child(element, entry.name);
    if (!child) continue;
    warnings.push_back(child->where.to_string() + ": ignored: " + entry.consequence);
    drop_children(element, {entry.name});
  }
}

struct Renamed {
  std::string_view tag;
  std::string_view type;
  std::string_view old_name;
  const char* new_name;
};
constexpr Renamed renamed[] = {
    {"bsdf", "diffuse", "diffuse_reflectance", "reflectance"},
    {"texture", "checkerboard", "color_0", "color0"},
    {"texture", "checkerboard", "color_1", "color1"},
    {"medium", "heterogeneous", "density", "sigma_t"},
};

void rename(XmlElement& element) {
  const std::string& type = element.get("type");
  for (const Renamed& entry : renamed)
    if (element.tag == entry.tag && type == entry.type && !find_child(element, entry.new_name))
      if (XmlElement* child = find_child(element, entry.old_name)) {
        child->set("name", entry.new_name);
        child->update_label();
      }
}

void upgrade_texture_filter(XmlElement& element, std::vector<std::string>& warnings) {
  XmlElement* filter = find_child(element, "filter_type");
  if (!filter || filter->tag != "string") return;
  const std::string value = filter->get("value");
  if (value != "ewa" && value != "trilinear") return;
  warnings.push_back(filter->where.to_string() + ": filter " + quote(value) + " is replaced by 'bilinear'");
  filter->set("value", "bilinear");
}

}  // namespace

std::string snake_case(const std::string& name) {
  std::string result;
  for (size_t i = 0; i < name.size(); ++i) {
    const bool begins_word = i > 0 && is_upper(name[i]) && is_lower(name[i - 1]);
    if (begins_word) result += '_';
    // A capital is lowered when it begins a word or goes on with an abbreviation ("intIOR"); names that begin
    // with one are left alone.
    const bool goes_on =
        i > 1 && is_upper(name[i]) && is_upper(name[i - 1]) && !result.empty() && is_lower(result.back());
    result += begins_word || goes_on ? static_cast<char>(name[i] - 'A' + 'a') : name[i];
  }
  return result;
}

void upgrade_element(XmlElement& element, std::vector<std::string>& warnings) {
  if (element.tag == "lookAt") element.tag = "lookat";
  if (const std::string* name = element.find("name"); name && element.tag != "default")
    element.set("name", snake_case(*name));
  element.update_label();
  if (element.tag == "texture" || element.tag == "bsdf") upgrade_texture_placement(element);
  if (element.tag == "texture" && element.get("type") == "bitmap") upgrade_texture_filter(element, warnings);
  rename(element);
  drop_obsolete(element, warnings);
}

}  // namespace fogbank::scene
