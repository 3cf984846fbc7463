// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/file_driver_reader.h"

#include <cctype>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/source.h"

namespace mbdae::reading {
namespace {

constexpr std::int64_t kMostColumns = 10000;

/// What the card says of the file.
struct Layout {
  SourcePosition where;             ///< of the file's name
  std::string name;                 ///< as the deck writes it
  std::size_t columns = 0;          ///< of numbers, without that of the times
  bool times = false;               ///< the first number of a row is its time
  std::optional<std::size_t> rows;  ///< none: as many as there are
  std::optional<double> start, step;
};

/// The numbers of a file, with its comments that give the initial time and the time step.
class Table {
 public:
  Table(Input& input, const Layout& layout) : input_(input), layout_(layout) {}

  FileTable read() {
    const std::string path = input_.path_of(layout_.name);
    std::string problem;
    if (!load_text(path, &text_, &problem)) {
      input_.fail(layout_.where, "the file " + quoted(layout_.name) + " cannot be read: " + problem);
    }
    table_.columns = layout_.columns;
    for (std::string_view rest = text_; !rest.empty() && !complete();) {
      const std::size_t end = std::min(rest.find('\n'), rest.size());
      ++line_;
      read_line(rest.substr(0, end));
      rest.remove_prefix(std::min(end + 1, rest.size()));
    }
    if (rows_ == 0) input_.fail(layout_.where, "the file " + quoted(layout_.name) + " has no numbers");
    if (layout_.rows && rows_ < *layout_.rows) {
      input_.fail(layout_.where, "the file " + quoted(layout_.name) + " has " + std::to_string(rows_) +
                                     " rows of numbers, expected " + std::to_string(*layout_.rows));
    }
    if (!layout_.times) set_times();
    return std::move(table_);
  }

 private:
  bool complete() const { return layout_.rows && rows_ == *layout_.rows; }

  [[noreturn]] void fail(const std::string& message) {
    input_.fail(layout_.where, quoted(layout_.name) + ", line " + std::to_string(line_) + ": " + message);
  }

  void read_line(std::string_view line) {
    skip_blanks(line);
    if (line.empty()) return;
    if (line.front() == '#') return read_comment(line);
    const std::size_t expected = table_.columns + (layout_.times ? 1 : 0);
    for (std::size_t k = 0; k < expected; ++k) {
      const double number = next(line, k, expected);
      if (k == 0 && layout_.times) {
        if (rows_ > 0 && !(number > table_.times.back())) {
          fail("found time " + number_text(number) + " after " + number_text(table_.times.back()) +
               ", expected increasing times");
        }
        table_.times.push_back(number);
      } else {
        table_.numbers.push_back(number);
      }
    }
    if (!line.empty()) {
      fail("found more than " + std::to_string(expected) + " numbers" + (layout_.times ? " (time included)" : ""));
    }
    ++rows_;
  }

  double next(std::string_view& line, std::size_t k, std::size_t expected) {
    const std::size_t end = std::min(line.find_first_of(" \t\r\v\f"), line.size());
    const std::string_view word = line.substr(0, end);
    double number = 0.0;
    const char* const begin = word.data() + (!word.empty() && word.front() == '+' ? 1 : 0);
    const auto [rest, error] = std::from_chars(begin, word.data() + word.size(), number);
    if (word.empty() || error != std::errc() || rest != word.data() + word.size() || !std::isfinite(number)) {
      fail((word.empty() ? "the line ends" : "found " + quoted(std::string(word.substr(0, 40)))) +
           ", expected number " + std::to_string(k + 1) + " of " + std::to_string(expected));
    }
    line.remove_prefix(end);
    skip_blanks(line);
    return number;
  }

  /// `# initial time: 0.`, `# time step: 0.1`
  void read_comment(std::string_view line) {
    for (const auto& [name, value] : {std::pair{"initial time:", &start_}, std::pair{"time step:", &step_}}) {
      const std::size_t at = line.find(name);
      if (at == std::string_view::npos) continue;
      std::string_view rest = line.substr(at + std::string_view(name).size());
      skip_blanks(rest);
      *value = next(rest, 0, 1);
    }
  }

  static void skip_blanks(std::string_view& line) {
    line.remove_prefix(std::min(line.find_first_not_of(" \t\r\v\f"), line.size()));
  }

  void set_times() {
    const std::optional<double> start = layout_.start ? layout_.start : start_;
    const std::optional<double> step = layout_.step ? layout_.step : step_;
    for (const auto& [value, name] : {std::pair{start, "initial time"}, std::pair{step, "time step"}}) {
      if (value) continue;
      input_.fail(layout_.where, "the file " + quoted(layout_.name) + " does not give the " + name +
                                     ", expected a line `# " + name + ": ...`");
    }
    if (!(*step > 0.0))
      input_.fail(layout_.where, "found the time step " + number_text(*step) + ", expected more than 0");
    for (std::size_t k = 0; k < rows_; ++k) table_.times.push_back(*start + static_cast<double>(k) * *step);
  }

  Input& input_;
  const Layout& layout_;
  std::string text_;
  FileTable table_;
  std::size_t rows_ = 0;
  int line_ = 0;
  std::optional<double> start_, step_;  // by comments
};

/// [word,] { value | from file }
std::optional<double> read_from_file(Input& input, const char* word) {
  input.need(word);
  input.take(word);
  input.need(word);
  if (input.take("from file")) return std::nullopt;
  return input.real(word);
}

}  // namespace

void read_file_driver(Context& context) {
  static constexpr const char* kKinds[] = {"fixed step", "variable step"};
  static constexpr const char* kOthers[] = {"socket", "rtai input", "stream", "bufferstream", "event stream"};
  static constexpr const char* kInterpolations[] = {"linear", "const"};
  Input& input = context.input;
  ++context.driver_count.found;
  const Label label = input.label("a file driver label");
  context.file_drivers.announce(input, label);
  skip_name(input);
  input.need([&] { return "the kind of file driver: " + joined(kKinds); });
  if (const auto words = input.peek_words()) {
    for (const char* other : kOthers) {
      if (words->is(other)) input.fail(words->where, std::string("not supported: the file driver `") + other + "`");
    }
  }
  Layout layout;
  layout.times = input.keyword(kKinds, "file driver") == 1;
  if (!layout.times && !input.take("count")) {
    const SourcePosition where = input.where();
    const std::int64_t rows = input.integer("the number of rows, or `count`");
    if (rows < 1) input.fail(where, "found " + std::to_string(rows) + " rows, expected 1 or more");
    layout.rows = static_cast<std::size_t>(rows);
  }
  const SourcePosition where = input.where();
  const std::int64_t columns = input.integer("the number of columns");
  if (columns < 1 || columns > kMostColumns) {
    input.fail(where, "found " + std::to_string(columns) + " columns, expected 1 to " + std::to_string(kMostColumns));
  }
  layout.columns = static_cast<std::size_t>(columns);
  if (!layout.times) {
    layout.start = read_from_file(input, "initial time");
    layout.step = read_from_file(input, "time step");
  }
  FileTable options;
  if (input.more() && input.take("interpolation")) {
    options.straight = input.keyword(kInterpolations, "interpolation") == 0;
  }
  if (input.more() && (input.take("pad zeroes") || input.take("pad zeros"))) {
    options.zero_outside = input.yes_no();
  } else if (const auto words = input.more() ? input.peek_words() : std::nullopt; words && words->is("bailout")) {
    input.fail(words->where, "not supported: the option `bailout` of a file driver (`pad zeroes, yes | no` is)");
  }
  layout.where = input.where();
  layout.name = input.string("the name of the file in quotes");
  FileTable table = Table(input, layout).read();
  table.straight = options.straight;
  table.zero_outside = options.zero_outside;
  input.end_card();
  context.file_drivers.define(label, std::make_shared<const FileTable>(std::move(table)));
}

DrivePtr read_file_drive(Context& context) {
  Input& input = context.input;
  const FileTablePtr table = context.file_drivers.get(input, input.label("the label of a file driver"));
  std::int64_t column = 1;
  const SourcePosition where = input.where();
  if (input.more() && (!input.at_words() || input.symbols().find(input.peek_text()))) {
    column = input.integer("the number of a column");
  }
  if (column < 1 || static_cast<std::size_t>(column) > table->columns) {
    input.fail(where, "found column " + std::to_string(column) + ", expected 1 to " + std::to_string(table->columns));
  }
  double amplitude = 1.0;
  if (input.more() && input.take("amplitude")) amplitude = input.real("the amplitude");
  ++context.file_drives;
  return std::make_shared<const FileDrive>(table, static_cast<std::size_t>(column) - 1, amplitude);
}

}  // namespace mbdae::reading
