// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/fem/fem_file.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string_view>
#include <unordered_set>

namespace mbdae::reading {
namespace {

constexpr std::string_view kRecord = "** RECORD GROUP ", kEnd = "** END OF FILE";
constexpr int kLastGroup = 19;

// A number takes two characters at least, so that a count can be refused before memory is asked for it.
constexpr double kCharactersPerNumber = 2.0;

bool blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\f' || c == '\v'; }

bool begins_with(std::string_view text, std::string_view start) { return text.substr(0, start.size()) == start; }

/// A record's heading in the wrong letters or with the wrong blanks, which MBDyn does not see.
bool looks_like_record(std::string_view line) {
  std::string plain;
  for (const char c : line.substr(0, 40)) {
    if (!blank(c)) plain += lower(c);
  }
  return begins_with(plain, "**recordgroup");
}

class FemReader {
 public:
  FemReader(const std::string& text, int file, Diagnostics& diagnostics)
      : text_(text), file_(file), diagnostics_(diagnostics) {}

  FemFile read() {
    while (next_record()) {
      const int group = group_;
      if (group != 1 && fem_.nodes == 0) {
        fail("record group " + std::to_string(group) +
             " comes before record group 1, which has the numbers of nodes and modes");
      }
      read_group(group);
      check_rest(group);
    }
    for (const int group : {1, 2, 5, 6, 7, 8, 9, 10}) {
      if (seen_[static_cast<std::size_t>(group)] != 0) continue;
      diagnostics_.fail({file_, line_, 1}, std::string("record group ") + std::to_string(group) + " (" + title(group) +
                                               ") is missing; the file ends here");
    }
    return std::move(fem_);
  }

 private:
  [[noreturn]] void fail(const std::string& message) { diagnostics_.fail({file_, line_, column()}, message); }
  void warn(const SourcePosition& where, const std::string& message) { diagnostics_.warning(where, message); }
  int column() const { return static_cast<int>(position_ - line_start_) + 1; }

  static const char* title(int group) {
    static constexpr const char* kTitles[] = {"",
                                              "header",
                                              "labels of the nodes",
                                              "initial modal displacements",
                                              "initial modal velocities",
                                              "x of the nodes",
                                              "y of the nodes",
                                              "z of the nodes",
                                              "mode shapes",
                                              "modal mass matrix",
                                              "modal stiffness matrix",
                                              "lumped masses",
                                              "rigid inertia",
                                              "modal damping matrix",
                                              "invariant I3",
                                              "invariant I4",
                                              "invariant I8",
                                              "invariant I5",
                                              "invariant I9",
                                              "stress stiffening"};
    return kTitles[group];
  }

  // ---- lines
  std::string_view line_text() const {
    const std::size_t end = text_.find('\n', line_start_);
    return std::string_view(text_).substr(line_start_, end == std::string::npos ? end : end - line_start_);
  }
  bool end_of_text() const { return position_ >= text_.size(); }
  void next_line() {
    const std::size_t end = text_.find('\n', line_start_);
    position_ = line_start_ = end == std::string::npos ? text_.size() : end + 1;
    if (end != std::string::npos) ++line_;
  }
  /// To the line after the next heading of a record; false at the end.
  bool next_record() {
    while (!end_of_text()) {
      const std::string_view line = line_text();
      if (begins_with(line, kEnd)) return false;
      if (begins_with(line, kRecord)) {
        const char* begin = line.data() + kRecord.size();
        int group = 0;
        const auto [end, error] = std::from_chars(begin, line.data() + line.size(), group);
        if (error != std::errc{} || end == begin) fail("found `** RECORD GROUP` without a number");
        if (group < 1 || group > kLastGroup || group == 19) {
          warn({file_, line_, 1}, "record group " + std::to_string(group) + " is not used");
          next_line();
          continue;
        }
        int& first = seen_[static_cast<std::size_t>(group)];
        if (first != 0) {
          fail("record group " + std::to_string(group) + " stands here again; the first one is on line " +
               std::to_string(first));
        }
        first = line_;
        group_ = group;
        next_line();
        return true;
      }
      if (looks_like_record(line)) {
        warn({file_, line_, 1},
             "this line is no heading of a record: it must begin with `** RECORD GROUP` and the number, in capitals, "
             "with one blank between the words");
      }
      next_line();
    }
    return false;
  }
  /// After the numbers of a group: says so if there are more of them.
  void check_rest(int group) {
    const SourcePosition where{file_, line_, column()};
    std::string_view rest = line_text();
    rest.remove_prefix(std::min(rest.size(), position_ - line_start_));
    bool more = false;
    for (const char c : rest) more = more || !blank(c);
    if (more) {
      warn(where, std::string("record group ") + std::to_string(group) + " (" + title(group) +
                      ") has more than the numbers of nodes and modes ask for: what follows is not read");
    }
    next_line();
  }

  // ---- words and numbers
  /// The next word, on this line or a later one; `what` names it in messages.
  std::string_view word(const std::string& what) {
    for (;;) {
      while (!end_of_text() && (blank(text_[position_]) || text_[position_] == '\n')) {
        if (text_[position_] == '\n') {
          next_line();
        } else {
          ++position_;
        }
      }
      break;
    }
    if (end_of_text()) fail("the file ends, expected " + what);
    if (begins_with(std::string_view(text_).substr(position_), "**")) {
      fail("found a line that begins with `**`, expected " + what);
    }
    const std::size_t begin = position_;
    while (!end_of_text() && !blank(text_[position_]) && text_[position_] != '\n') ++position_;
    return std::string_view(text_).substr(begin, position_ - begin);
  }

  std::string progress(int group, Eigen::Index k, Eigen::Index count) const {
    return "number " + std::to_string(k + 1) + " of " + std::to_string(count) + " of record group " +
           std::to_string(group) + " (" + title(group) + ")";
  }

  double number(int group, Eigen::Index k, Eigen::Index count) {
    // The name of the number is made only when something is wrong.
    while (!end_of_text() && (blank(text_[position_]) || text_[position_] == '\n')) {
      if (text_[position_] == '\n') {
        next_line();
      } else {
        ++position_;
      }
    }
    const char* begin = text_.data() + position_;
    const char* limit = text_.data() + text_.size();
    const char* start = begin != limit && *begin == '+' ? begin + 1 : begin;
    double value = 0.0;
    const auto [end, error] = std::from_chars(start, limit, value);
    const bool whole = end == limit || blank(*end) || *end == '\n';
    if (error == std::errc{} && whole && std::isfinite(value)) {
      position_ += static_cast<std::size_t>(end - begin);
      return value;
    }
    const std::string what = progress(group, k, count);
    const std::size_t place = position_;
    const std::string found(word(what));
    position_ = place;
    if (error == std::errc::result_out_of_range) {
      fail("found " + quoted(found) + ", a number that is too large or too small, expected " + what);
    }
    if (error == std::errc{} && whole) fail("found " + quoted(found) + ", expected a finite number: " + what);
    const bool fortran = error == std::errc{} && (*end == 'D' || *end == 'd');
    fail("found " + quoted(found) + ", expected " + what + (fortran ? "; write the exponent with E, not with D" : ""));
  }

  Eigen::VectorXd numbers(int group, Eigen::Index count) {
    Eigen::VectorXd out(count);
    for (Eigen::Index k = 0; k < count; ++k) out(k) = number(group, k, count);
    return out;
  }

  /// Row after row.
  Eigen::MatrixXd matrix(int group, Eigen::Index rows, Eigen::Index columns) {
    require_room(group, static_cast<double>(rows) * static_cast<double>(columns));
    Eigen::MatrixXd out(rows, columns);
    for (Eigen::Index i = 0; i < rows; ++i) {
      for (Eigen::Index j = 0; j < columns; ++j) out(i, j) = number(group, i * columns + j, rows * columns);
    }
    return out;
  }

  /// Refuses counts of which the file cannot have so many numbers.
  void require_room(int group, double count) {
    const double left = static_cast<double>(text_.size() - position_);
    if (count * kCharactersPerNumber <= left + kCharactersPerNumber) return;
    fail("record group " + std::to_string(group) + " (" + title(group) + ") has to have " + number_text(count) +
         " numbers for " + std::to_string(fem_.nodes) + " nodes and " + std::to_string(fem_.modes) +
         " modes, but the file ends after " + number_text(left) + " more characters");
  }

  std::int64_t count(const std::string& what) {
    const std::string text(word(what));
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) {
      fail("found " + quoted(text) + ", expected " + what);
    }
    if (value < 0 || value > std::numeric_limits<int>::max()) {
      fail("found " + quoted(text) + ", expected " + what + " from 0 to 2147483647");
    }
    return value;
  }

  // ---- groups
  void read_group(int group) {
    const Eigen::Index n = fem_.nodes, m = fem_.modes;
    switch (group) {
      case 1:
        return read_header();
      case 2:
        return read_labels();
      case 3:
        fem_.a = numbers(group, m);
        return;
      case 4:
        fem_.adot = numbers(group, m);
        return;
      case 5:
      case 6:
      case 7:
        fem_.points.row(group - 5) = numbers(group, n).transpose();
        return;
      case 8:
        return read_shapes();
      case 9:
        return read_mass();
      case 10:
        fem_.K = matrix(group, m, m);
        return;
      case 11:
        return read_lumped();
      case 12:
        return read_rigid();
      case 13:
        fem_.C = matrix(group, m, m);
        return;
      case 14:
        fem_.I3 = matrix(group, 3, m);
        return;
      case 15:
        fem_.I4 = matrix(group, 3, m);
        return;
      case 16:
        fem_.I8 = matrix(group, 3, 3 * m);
        return;
      case 17:
        fem_.I5 = matrix(group, 3, m * m);
        return;
      default:
        fem_.I9 = matrix(group, 3, 3 * m * m);
        return;
    }
  }

  void read_header() {
    const std::string_view comment = line_text();
    if (begins_with(comment, "REV")) fail("found no line of comment (`** ...`) after the heading of record group 1");
    next_line();
    word("the revision (as in `REV0`)");
    const std::int64_t nodes = count("the number of nodes");
    const std::int64_t normal = count("the number of normal modes");
    const std::int64_t attachment = count("the number of attachment modes");
    const std::int64_t constraint = count("the number of constraint modes");
    const std::int64_t rejected = count("the number of rejected modes");
    const std::int64_t modes = normal + attachment + constraint - rejected;
    if (nodes < 1) fail("found 0 nodes, expected 1 or more");
    if (modes < 1) {
      fail("found " + std::to_string(modes) +
           " modes (normal + attachment + constraint - rejected), expected 1 or more");
    }
    // Labels, coordinates, shapes and two matrices have to follow.
    const double n = static_cast<double>(nodes), m = static_cast<double>(modes);
    const double least = kCharactersPerNumber * (4.0 * n + 6.0 * n * m + 2.0 * m * m);
    if (least > static_cast<double>(text_.size())) {
      fail("found " + std::to_string(nodes) + " nodes and " + std::to_string(modes) + " modes, which need a file of " +
           number_text(least) + " characters at least; this one has " + std::to_string(text_.size()));
    }
    fem_.nodes = static_cast<int>(nodes);
    fem_.modes = static_cast<int>(modes);
    fem_.points.setZero(3, nodes);
    fem_.a.setZero(modes);
    fem_.adot.setZero(modes);
  }

  void read_labels() {
    fem_.labels.reserve(static_cast<std::size_t>(fem_.nodes));
    for (int i = 0; i < fem_.nodes; ++i) {
      fem_.labels.emplace_back(word("label " + std::to_string(i + 1) + " of " + std::to_string(fem_.nodes) + " nodes"));
    }
  }

  void read_shapes() {
    const Eigen::Index n = fem_.nodes, m = fem_.modes;
    require_room(8, 6.0 * static_cast<double>(n) * static_cast<double>(m));
    fem_.shape.assign(static_cast<std::size_t>(n), Eigen::MatrixXd(6, m));
    for (Eigen::Index k = 0; k < m; ++k) {
      if (k > 0) {
        check_rest(8);
      }
      const std::string_view heading = line_text();
      bool empty = true;
      for (const char c : heading) empty = empty && blank(c);
      if (end_of_text() || (!empty && !begins_with(heading, "**")) || begins_with(heading, kRecord) ||
          begins_with(heading, kEnd)) {
        fail("expected a line of comment (`** ...`) or an empty one before mode " + std::to_string(k + 1) + " of " +
             std::to_string(m));
      }
      next_line();
      for (Eigen::Index i = 0; i < n; ++i) {
        for (int j = 0; j < 6; ++j) {
          fem_.shape[static_cast<std::size_t>(i)](j, k) = number(8, (k * n + i) * 6 + j, 6 * n * m);
        }
      }
    }
  }

  void read_mass() {
    fem_.M = matrix(9, fem_.modes, fem_.modes);
    for (int k = 0; k < fem_.modes; ++k) {
      if (!(fem_.M(k, k) >= 0.0)) {
        fail("the modal mass of mode " + std::to_string(k + 1) + " is " + number_text(fem_.M(k, k)) +
             ", expected 0 or more");
      }
    }
  }

  void read_lumped() {
    require_room(11, 6.0 * fem_.nodes);
    Eigen::Matrix4Xd lumped(4, fem_.nodes);
    bool told = false;
    for (int i = 0; i < fem_.nodes; ++i) {
      std::array<double, 6> row{};
      for (int j = 0; j < 6; ++j) row[static_cast<std::size_t>(j)] = number(11, 6 * i + j, 6 * fem_.nodes);
      for (int j = 0; j < 6; ++j) {
        if (row[static_cast<std::size_t>(j)] >= 0.0) continue;
        fail("node " + std::to_string(i + 1) + " has a negative " + (j < 3 ? "mass" : "moment of inertia") + ", " +
             number_text(row[static_cast<std::size_t>(j)]));
      }
      if (!told && (row[1] != row[0] || row[2] != row[0])) {
        warn({file_, line_, 1},
             "node " + std::to_string(i + 1) + " has different masses along the axes: only the first one counts");
        told = true;
      }
      lumped.col(i) << row[0], row[3], row[4], row[5];
    }
    fem_.lumped = lumped;
  }

  void read_rigid() {
    FemRigidBody rigid;
    const Eigen::VectorXd all = numbers(12, 13);
    rigid.m = all(0);
    rigid.c = all.segment<3>(1);
    for (int i = 0; i < 3; ++i) rigid.J.row(i) = all.segment<3>(4 + 3 * i).transpose();
    if (rigid.m < 0.0) fail("the total mass is " + number_text(rigid.m) + " kg, expected 0 or more");
    fem_.rigid = rigid;
  }

  const std::string& text_;
  int file_;
  Diagnostics& diagnostics_;
  FemFile fem_;
  std::array<int, kLastGroup + 1> seen_{};  ///< line of the group's heading, 0 = not seen
  int group_ = 0;
  int line_ = 1;
  std::size_t line_start_ = 0, position_ = 0;
};

}  // namespace

FemFile read_fem(const std::string& text, int file, Diagnostics& diagnostics) {
  return FemReader(text, file, diagnostics).read();
}

}  // namespace mbdae::reading
