#include "scene/xml/limits.h"

#include <algorithm>

#include "scene/loader.h"

namespace fogbank::scene {
namespace {

class LimitScan {
 public:
  LimitScan(std::string_view text, const std::string& file, int depth, XmlBudget& budget)
      : text_(text), file_(file), depth_(depth), budget_(budget) {}

  void run() {
    while (position_ < text_.size()) {
      position_ = std::min(text_.find('<', position_), text_.size());
      const std::string_view rest = text_.substr(position_);
      if (rest.starts_with("<!--")) {
        skip_past("-->");
      } else if (rest.starts_with("<![CDATA[")) {
        skip_past("]]>");
      } else if (rest.starts_with("<?")) {
        skip_past("?>");
      } else if (rest.starts_with("<!")) {
        document_type();
      } else if (rest.starts_with("</")) {
        --depth_;
        skip_past(">");
      } else if (!rest.empty()) {
        start_tag();
      }
    }
  }

 private:
  void skip_past(std::string_view end) {
    const size_t found = text_.find(end, position_);
    position_ = found == std::string_view::npos ? text_.size() : found + end.size();
  }

  void document_type() {
    const size_t end = text_.find_first_of("[>", position_);
    if (end != std::string_view::npos && text_[end] == '[')
      refuse(ErrorKind::invalid_argument, "XML_DOCTYPE_REFUSED",
             "document type declarations and entities are not read");
    skip_past(">");
  }

  void start_tag() {
    if (--budget_.elements < 0)
      refuse(ErrorKind::resource_exhausted, "XML_TOO_MANY_ELEMENTS",
             "more than " + std::to_string(LoadLimits::elements) + " elements");
    if (++depth_ > LoadLimits::depth)
      refuse(ErrorKind::resource_exhausted, "XML_TOO_DEEP",
             "elements are nested more than " + std::to_string(LoadLimits::depth) + " deep");
    for (++position_; position_ < text_.size(); ++position_) {
      const char c = text_[position_];
      if (c == '>') {
        if (text_[position_ - 1] == '/') --depth_;
        ++position_;
        return;
      }
      if (c == '"' || c == '\'') attribute_value(c);
    }
  }

  void attribute_value(char delimiter) {
    if (--budget_.attributes < 0)
      refuse(ErrorKind::resource_exhausted, "XML_TOO_MANY_ELEMENTS",
             "more than " + std::to_string(LoadLimits::attributes) + " attributes");
    const size_t begin = position_ + 1;
    const size_t end = std::min(text_.find(delimiter, begin), text_.size());
    if (end - begin > LoadLimits::attribute_bytes)
      refuse(ErrorKind::resource_exhausted, "XML_ATTRIBUTE_TOO_LONG",
             "an attribute has " + std::to_string(end - begin) + " bytes; at most " +
                 std::to_string(LoadLimits::attribute_bytes) + " are read");
    position_ = end;
  }

  [[noreturn]] void refuse(ErrorKind kind, const std::string& reason, const std::string& message) const {
    const std::string_view before = text_.substr(0, std::min(position_, text_.size()));
    const auto line = static_cast<int>(std::count(before.begin(), before.end(), '\n')) + 1;
    throw SceneError(kind, reason, {file_, line, ""}, message);
  }

  std::string_view text_;
  const std::string& file_;
  int depth_;
  XmlBudget& budget_;
  size_t position_ = 0;
};

}  // namespace

void check_xml_limits(std::string_view text, const std::string& file, int depth, XmlBudget& budget) {
  LimitScan(text, file, depth, budget).run();
}

}  // namespace fogbank::scene
