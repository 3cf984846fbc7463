// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/format_text.h"

#include <array>
#include <cstdio>
#include <string_view>

#include "mbdae/deck/diagnostic.h"

namespace mbdae::reading {
namespace {

/// The conversion in a format: from its `%` to its letter.
struct Conversion {
  std::size_t begin = std::string::npos;
  std::size_t end = 0;
};

bool find_conversion(const std::string& format, Conversion* found, std::string* problem) {
  for (std::size_t i = 0; i < format.size(); ++i) {
    if (format[i] != '%') continue;
    if (i + 1 < format.size() && format[i + 1] == '%') {
      ++i;
      continue;
    }
    if (found->begin != std::string::npos) {
      found->begin = std::string::npos;
      break;
    }
    found->begin = i;
    found->end = format.find_first_not_of("+- #0123456789.", i + 1);
    if (found->end == std::string::npos || found->end - i > 8) {
      *problem = "sprintf cannot read the conversion in its format";
      return false;
    }
    i = found->end;
  }
  if (found->begin == std::string::npos) *problem = "sprintf wants one conversion (%d, %g, %s, ...) in its format";
  return found->begin != std::string::npos;
}

bool has_wide_numbers(std::string_view flags) {
  int digits = 0;
  for (const char c : flags) {
    digits = c >= '0' && c <= '9' ? digits + 1 : 0;
    if (digits > 2) return true;
  }
  return false;
}

/// The text outside of the conversion, with %% as %.
std::string literal(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    out += text[i];
    if (text[i] == '%') ++i;
  }
  return out;
}

template <class T>
std::string printed(const std::string& conversion, T value) {
  std::array<char, 512> buffer;  // the largest double has 309 digits, widths and precisions have two
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
  std::snprintf(buffer.data(), buffer.size(), conversion.c_str(), value);
#pragma GCC diagnostic pop
  return buffer.data();
}

}  // namespace

bool format_text(const std::string& format, const Value<double>& value, std::string* out, std::string* problem) {
  Conversion found;
  if (!find_conversion(format, &found, problem)) return false;
  const std::string conversion = format.substr(found.begin, found.end + 1 - found.begin);
  if (has_wide_numbers(conversion)) {
    *problem = "sprintf widths have two digits at most";
    return false;
  }
  const char kind = conversion.back();
  const bool whole = value.type == Type::integer || value.type == Type::boolean;
  std::string text;
  if ((kind == 'd' || kind == 'i') && whole) {
    text = printed(conversion, static_cast<int>(value.integer));
  } else if (std::string_view("eEfFgG").find(kind) != std::string_view::npos && value.type != Type::string) {
    text = printed(conversion, whole ? static_cast<double>(value.integer) : value.real);
  } else if (kind == 's' && value.type == Type::string) {
    text = printed(conversion, value.text.c_str());
  } else {
    *problem =
        std::string("sprintf cannot write a value of type ") + type_name(value.type) + " as " + quoted(conversion);
    return false;
  }
  const std::string_view view = format;
  *out = literal(view.substr(0, found.begin)) + text + literal(view.substr(found.end + 1));
  return true;
}

}  // namespace mbdae::reading
