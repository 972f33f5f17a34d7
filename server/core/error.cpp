#include "core/error.h"

namespace fogbank {

std::string SourceLocation::to_string() const {
  std::string text = file;
  if (line > 0) text += ":" + std::to_string(line);
  if (!element.empty()) text += ": " + element;
  return text;
}

}  // namespace fogbank
