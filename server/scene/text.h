// Text helpers for messages about scene files.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace fogbank::scene {

/// `text` in single quotes, fit for a message or a log line: control characters escaped as \xNN, cut after
/// 100 bytes.
std::string quote(std::string_view text);

/// Sorted and comma-separated: "a, b, c".
std::string list_names(std::vector<std::string> names);

/// "; did you mean 'x'?" for the candidate nearest to `name` in edit distance, or "" when none is near.
std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates);

/// Shortest decimal that reads back as the same number.
std::string number_text(double value);

}  // namespace fogbank::scene
