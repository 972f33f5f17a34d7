// Checks of text encoding.
#pragma once

#include <string_view>

namespace fogbank::scene {

/// Well-formed UTF-8 by RFC 3629: no overlong forms, no surrogates, nothing above U+10FFFF.
bool is_valid_utf8(std::string_view text);

}  // namespace fogbank::scene
