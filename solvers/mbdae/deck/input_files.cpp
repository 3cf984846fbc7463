// The files of a deck: itself, what it includes, where others are looked for.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "mbdae/deck/arguments.h"
#include "mbdae/deck/source.h"

namespace mbdae::reading {
namespace {

constexpr std::size_t kDeepestInclude = 32;
constexpr int kMostIncludes = 10000;
constexpr std::size_t kMostCharacters = std::size_t{256} << 20;  // of a deck with all its includes, 256 MiB

}  // namespace

void Input::open(std::string text, const std::string& name) { push(std::move(text), name); }

void Input::push(std::string text, const std::string& name) {
  const int file = diagnostics_.add_file(name);
  characters_read_ += text.size();
  auto source =
      std::make_unique<Source>(Source{std::move(text), name, {}, {}, TokenStream(Lexer(std::string_view(), file))});
  std::string_view view = source->text;
  if (view.substr(0, 3) == "\xef\xbb\xbf") view.remove_prefix(3);  // byte order mark
  source->tokens = TokenStream(Lexer(view, file));
  sources_.push_back(std::move(source));
}

std::string Input::path_of(const std::string& name) const {
  const Source& source = *sources_.back();
  const std::string from = source.directory.empty() ? source.name : source.directory + "/";
  return relative_to(from, name);
}

void Input::change_directory() {
  const SourcePosition where = this->where();
  const std::string path = path_of(string("a directory in quotes"));
  end_card();
  if (!is_directory(path)) fail(where, "there is no directory " + quoted(path));
  sources_.back()->directory = path.empty() ? "." : path;
}

void Input::include() {
  const SourcePosition where = this->where();
  const std::string name = string("a file name in quotes");
  end_card();
  const std::string path = path_of(name);
  const std::string canonical = canonical_name(path);
  for (const auto& source : sources_) {
    if (source->canonical.empty()) source->canonical = canonical_name(source->name);
    if (source->canonical == canonical) fail(where, "include loop: " + quoted(path) + " is being read already");
  }
  if (sources_.size() > kDeepestInclude) {
    fail(where, "includes nested deeper than " + std::to_string(kDeepestInclude) + " files");
  }
  if (++includes_ > kMostIncludes) fail(where, "more than " + std::to_string(kMostIncludes) + " files are included");
  std::string text, problem;
  if (!load_text(path, &text, &problem)) fail(where, "cannot include " + quoted(path) + ": " + problem);
  if (characters_read_ + text.size() > kMostCharacters) {
    fail(where, "the deck and its includes are larger than 256 MiB together");
  }
  push(std::move(text), path);
}

}  // namespace mbdae::reading
