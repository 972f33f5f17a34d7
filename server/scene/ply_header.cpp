#include "scene/ply_header.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

namespace fogbank::scene {

namespace {

constexpr size_t most_header_lines = 4096;

/// Splits the header into lines and words.
class HeaderReader {
 public:
  HeaderReader(const std::string& bytes, const MeshFile& file) : bytes_(bytes), file_(file) {}

  PlyHeader read() {
    if (next_line() != std::vector<std::string_view>{"ply"})
      file_.damaged_at_line(1, "a PLY file begins with \"ply\"");
    PlyHeader header;
    bool has_format = false;
    while (true) {
      const auto words = next_line();
      if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      if (words[0] == "format") {
        header.encoding = read_format(words);
        has_format = true;
      } else if (words[0] == "element") {
        header.elements.push_back(read_element(words));
      } else if (words[0] == "property") {
        if (header.elements.empty()) fail("a property before any element");
        header.elements.back().properties.push_back(read_property(words));
      } else {
        fail("\"" + std::string(words[0].substr(0, 40)) + "\" is not a statement of a PLY header");
      }
    }
    if (!has_format) fail("the header states no format");
    header.data_offset = offset_;
    header.data_line = line_ + 1;
    check_counts(header);
    return header;
  }

 private:
  [[noreturn]] void fail(const std::string& message) const { file_.damaged_at_line(line_, message); }

  std::vector<std::string_view> next_line() {
    ++line_;
    const size_t end = bytes_.find('\n', offset_);
    if (end == std::string::npos || line_ > most_header_lines) fail("the header has no end");
    std::string_view text(bytes_.data() + offset_, end - offset_);
    offset_ = end + 1;
    if (!text.empty() && text.back() == '\r') text.remove_suffix(1);
    std::vector<std::string_view> words;
    while (!text.empty()) {
      const size_t start = text.find_first_not_of(" \t");
      if (start == std::string_view::npos) break;
      const size_t stop = std::min(text.find_first_of(" \t", start), text.size());
      words.push_back(text.substr(start, stop - start));
      text.remove_prefix(stop);
    }
    return words;
  }

  PlyEncoding read_format(const std::vector<std::string_view>& words) const {
    if (words.size() != 3 || words[2] != "1.0") fail("the format must be version 1.0");
    if (words[1] == "ascii") return PlyEncoding::ascii;
    if (words[1] == "binary_little_endian") return PlyEncoding::little_endian;
    if (words[1] == "binary_big_endian") return PlyEncoding::big_endian;
    fail("unknown format; ascii, binary_little_endian and binary_big_endian are supported");
  }

  PlyElement read_element(const std::vector<std::string_view>& words) const {
    PlyElement element;
    if (words.size() != 3) fail("an element needs a name and a count");
    element.name = words[1];
    const char* stop = words[2].data() + words[2].size();
    const auto [rest, code] = std::from_chars(words[2].data(), stop, element.count);
    if (code != std::errc() || rest != stop)
      fail("\"" + std::string(words[2].substr(0, 40)) + "\" is not a count");
    return element;
  }

  PlyType read_type(std::string_view name) const {
    static constexpr std::array<std::pair<std::string_view, PlyType>, 16> types = {
        {{"char", PlyType::int8},
         {"int8", PlyType::int8},
         {"uchar", PlyType::uint8},
         {"uint8", PlyType::uint8},
         {"short", PlyType::int16},
         {"int16", PlyType::int16},
         {"ushort", PlyType::uint16},
         {"uint16", PlyType::uint16},
         {"int", PlyType::int32},
         {"int32", PlyType::int32},
         {"uint", PlyType::uint32},
         {"uint32", PlyType::uint32},
         {"float", PlyType::float32},
         {"float32", PlyType::float32},
         {"double", PlyType::float64},
         {"float64", PlyType::float64}}};
    for (const auto& [known, type] : types) {
      if (known == name) return type;
    }
    fail("\"" + std::string(name.substr(0, 40)) + "\" is not a type of a PLY file");
  }

  PlyProperty read_property(const std::vector<std::string_view>& words) const {
    PlyProperty property;
    if (words.size() == 3) {
      property.type = read_type(words[1]);
    } else if (words.size() == 5 && words[1] == "list") {
      property.is_list = true;
      property.count_type = read_type(words[2]);
      property.type = read_type(words[3]);
      if (property.count_type == PlyType::float32 || property.count_type == PlyType::float64)
        fail("a list's count must be an integer");
    } else {
      fail("a property is \"property <type> <name>\" or \"property list <type> <type> <name>\"");
    }
    property.name = words.back();
    return property;
  }

  void check_counts(const PlyHeader& header) const {
    size_t left = bytes_.size() - offset_;
    for (const PlyElement& element : header.elements) {
      if (element.properties.empty())
        file_.damaged("header", "element \"" + element.name + "\" has no properties");
      size_t least = 0;
      // A value of an ASCII file takes a digit and a separator; the last separator may be missing.
      for (const PlyProperty& property : element.properties)
        least += header.encoding == PlyEncoding::ascii ? 2 : property.least_bytes();
      if (element.count > (left + 1) / least)
        file_.damaged("header", "claims " + std::to_string(element.count) + " elements \"" + element.name +
                                    "\", more than the rest of the file can hold");
      left -= std::min(left, static_cast<size_t>(element.count) * least);
    }
  }

  const std::string& bytes_;
  const MeshFile& file_;
  size_t offset_ = 0;
  size_t line_ = 0;
};

}  // namespace

size_t byte_size(PlyType type) {
  switch (type) {
    case PlyType::int8:
    case PlyType::uint8:
      return 1;
    case PlyType::int16:
    case PlyType::uint16:
      return 2;
    case PlyType::float64:
      return 8;
    default:
      return 4;
  }
}

int PlyElement::find(std::initializer_list<std::string_view> names) const {
  for (size_t i = 0; i < properties.size(); ++i) {
    if (std::find(names.begin(), names.end(), properties[i].name) != names.end()) return static_cast<int>(i);
  }
  return -1;
}

PlyHeader read_ply_header(const std::string& bytes, const MeshFile& file) {
  return HeaderReader(bytes, file).read();
}

}  // namespace fogbank::scene
