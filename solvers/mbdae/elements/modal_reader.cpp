// Grammar of `joint: modal` and `force: modal`, and what follows from the `.fem` file.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/source.h"
#include "mbdae/elements/ends.h"
#include "mbdae/elements/modal_data.h"
#include "mbdae/elements/modal_inertia.h"
#include "mbdae/fem/fem_file.h"

namespace mbdae::reading {
namespace {

/// Default of `find closest`: how far the nearest node may be [m].
constexpr double kClosest = 1e-12;

struct InitialValue {
  SourcePosition where;
  std::int64_t mode = 0;  ///< 0: by position
  double a = 0.0, b = 0.0;
};

struct Damping {
  enum class Kind { unsaid, none, file, single, rayleigh, diagonal } kind = Kind::unsaid;
  SourcePosition where;
  double factor = 0.0, alpha = 0.0, beta = 0.0;
  Eigen::VectorXd ratios;
};

struct Thresholds {
  double M = 0.0, C = 0.0, K = 0.0;
};

void cut(Eigen::MatrixXd& A, double threshold) {
  if (threshold <= 0.0) return;
  A = (A.array().abs() < threshold).select(0.0, A);
}

class ModalReader {
 public:
  explicit ModalReader(Context& context) : context_(context), input_(context.input) {}

  ModalData read() {
    read_carrier();
    read_modes();
    read_initial_values();
    read_node_count();
    read_damping();
    read_file();
    read_options();
    select();
    read_interfaces();
    if (input_.more()) {
      const SourcePosition where = input_.where();
      if (input_.take_numbered("use invariant", "9")) use_invariant_9(where);
    }
    return std::move(joint_);
  }

 private:
  void fail(const SourcePosition& where, const std::string& message) { input_.fail(where, message); }

  // ---- in the order of the card
  void read_carrier() {
    input_.need("a modal node or `clamped`");
    if (input_.take("clamped")) {
      if (input_.more() && input_.take("position")) joint_.x = read_position(context_, {});
      if (input_.more() && input_.take("orientation")) joint_.R = read_orientation(context_, {});
      return;
    }
    const SourcePosition where = input_.where();
    joint_.node = context_.node();
    const NodeData& node = context_.deck.nodes[*joint_.node];
    if (node.kind != NodeKind::modal_node) {
      fail(where,
           quoted(node.id.name) + " is no modal node: declare it `structural: ..., modal, ...;`, or say `clamped`");
    }
    for (const ElementData& other : context_.deck.joints) {
      const auto* data = other.get_if<ModalData>();
      if (data != nullptr && data->node == joint_.node) {
        fail(where, quoted(node.id.name) + " carries the modal joint " + std::to_string(other.id.label) + " already");
      }
    }
  }

  void read_modes() {
    modes_where_ = input_.where();
    const std::int64_t count = input_.integer("the number of modes");
    if (count < 1 || count > 100000) {
      fail(modes_where_, "found " + std::to_string(count) + " modes, expected 1 to those of the file");
    }
    m_ = static_cast<int>(count);
    if (!input_.more() || !input_.take("list")) return;
    for (int k = 0; k < m_; ++k) {
      const SourcePosition where = input_.where();
      const std::int64_t number = input_.integer("the number of a mode");
      if (!list_.empty() && number <= list_.back()) {
        fail(where, "found mode " + std::to_string(number) + " after " + std::to_string(list_.back()) +
                        ": list the modes in ascending order (MBDyn mixes up others)");
      }
      if (number < 1) fail(where, "found mode " + std::to_string(number) + ", modes count from 1");
      list_.push_back(number);
      list_where_.push_back(where);
    }
  }

  void read_initial_values() {
    if (!input_.more() || !input_.take("initial value")) return;
    initial_ = true;
    bool named = false;
    while (input_.more() && input_.take("mode")) {
      named = true;
      InitialValue value;
      value.where = input_.where();
      value.mode = input_.integer("the number of a mode in the file");
      value.a = input_.real("the initial displacement of the mode");
      value.b = input_.real("the initial velocity of the mode");
      values_.push_back(value);
    }
    if (named) return;
    const SourcePosition where = input_.where();
    for (int k = 0; k < m_; ++k) {
      InitialValue value;
      value.a = input_.real("the initial displacement of a mode");
      value.b = input_.real("the initial velocity of a mode");
      values_ = {value};  // every pair replaces the one before, as in MBDyn
    }
    if (m_ > 1) {
      input_.diagnostics().warning(where,
                                   "as in MBDyn the first mode takes the last pair of these initial values and the "
                                   "others are zero: write `initial value, mode, 1, q, qdot, mode, 2, ...`");
    }
  }

  void read_node_count() {
    input_.need("the number of finite element nodes or `from file`");
    if (input_.take("from file")) return;
    count_where_ = input_.where();
    count_ = input_.integer("the number of finite element nodes");
  }

  void read_damping() {
    using Kind = Damping::Kind;
    if (!input_.more()) return;
    damping_.where = input_.where();
    if (input_.take("no damping")) {
      damping_.kind = Kind::none;
    } else if (input_.take("damping from file")) {
      damping_.kind = Kind::file;
    } else if (input_.take("single factor damping")) {
      damping_.kind = Kind::single;
      damping_.factor = input_.real("a damping ratio");
    } else if (input_.take("proportional damping")) {
      input_.diagnostics().warning(damping_.where, "`proportional damping` is read as `single factor damping`");
      damping_.kind = Kind::single;
      damping_.factor = input_.real("a damping ratio");
    } else if (input_.take("rayleigh damping")) {
      damping_.kind = Kind::rayleigh;
      damping_.alpha = input_.real("the factor of the mass matrix [1/s]");
      damping_.beta = input_.real("the factor of the stiffness matrix [s]");
    } else if (input_.take("diag damping")) {
      read_diagonal_damping();
    }
  }

  void read_diagonal_damping() {
    damping_.kind = Damping::Kind::diagonal;
    damping_.ratios.setZero(m_);
    input_.need("`all` or a number of modes");
    if (input_.take("all")) {
      for (int k = 0; k < m_; ++k) damping_.ratios(k) = input_.real("a damping ratio");
      return;
    }
    const SourcePosition where = input_.where();
    const std::int64_t count = input_.integer("the number of damped modes");
    if (count < 0 || count > m_) {
      fail(where, "found " + std::to_string(count) + " damped modes, expected 0 to " + std::to_string(m_));
    }
    for (std::int64_t i = 0; i < count; ++i) {
      const SourcePosition mode_where = input_.where();
      const std::int64_t k = input_.integer("a mode, counted among those in use");
      if (k < 1 || k > m_) {
        fail(mode_where, "found mode " + std::to_string(k) + ", expected 1 to " + std::to_string(m_) +
                             ": modes count among those in use here");
      }
      damping_.ratios(static_cast<int>(k) - 1) = input_.real("a damping ratio");
    }
  }

  void read_file() {
    const SourcePosition where = input_.where();
    const std::string name = input_.string("the name of the `.fem` file in quotes");
    const std::string path = input_.path_of(name);
    std::string text, problem;
    if (!load_text(path, &text, &problem)) fail(where, "the file " + quoted(name) + " cannot be read: " + problem);
    file_index_ = input_.diagnostics().add_file(path);
    file_ = read_fem(text, file_index_, input_.diagnostics());
    if (count_ && *count_ != file_.nodes) {
      fail(count_where_, "found " + std::to_string(*count_) + " finite element nodes, the file " + quoted(name) +
                             " has " + std::to_string(file_.nodes) + ": write that, or `from file`");
    }
    if (m_ > file_.modes) {
      fail(modes_where_,
           "found " + std::to_string(m_) + " modes, the file " + quoted(name) + " has " + std::to_string(file_.modes));
    }
    for (std::size_t k = 0; k < list_.size(); ++k) {
      if (list_[k] > file_.modes) {
        fail(list_where_[k], "found mode " + std::to_string(list_[k]) + ", the file " + quoted(name) + " has " +
                                 std::to_string(file_.modes) + " modes");
      }
    }
  }

  void read_options() {
    origin_.setZero();
    while (input_.more()) {
      const SourcePosition where = input_.where();
      if (input_.take("threshold")) {
        thresholds_.M = thresholds_.C = thresholds_.K = threshold();
      } else if (input_.take("mass threshold")) {
        thresholds_.M = threshold();
      } else if (input_.take("damping threshold")) {
        thresholds_.C = threshold();
      } else if (input_.take("stiffness threshold")) {
        thresholds_.K = threshold();
      } else if (input_.take("create binary") || input_.take("use binary") || input_.take("update binary")) {
        input_.diagnostics().warning(where, "binary mode files are neither written nor read: the text is used");
      } else if (input_.take("echo")) {
        input_.string("a file name in quotes");
        if (input_.more() && input_.take("precision")) input_.integer("a number of digits");
        input_.diagnostics().warning(where, "no echo of the `.fem` file is written");
      } else if (input_.take("origin node")) {
        origin_ = file_.points.col(find(where, fem_label("the label of a finite element node")));
      } else if (input_.take("origin position")) {
        origin_ = read_vec3(input_, "a coordinate of the origin [m]");
      } else {
        return;
      }
    }
  }

  double threshold() {
    const SourcePosition where = input_.where();
    const double value = input_.real("the size below which entries are set to zero");
    if (!(value >= 0.0)) fail(where, "found " + number_text(value) + ", expected 0 or more");
    return value;
  }

  void read_interfaces() {
    const SourcePosition where = input_.where();
    const std::int64_t count = input_.integer("the number of interface nodes");
    if (count < 0 || count > file_.nodes) {
      fail(where, "found " + std::to_string(count) + " interface nodes, expected 0 to the " +
                      std::to_string(file_.nodes) + " of the file");
    }
    double tolerance = kClosest;
    for (bool option = true; option && input_.more();) {
      option = skip_output(input_);
      if (input_.more() && input_.take("interface tolerance")) {
        tolerance = input_.positive("the tolerance of `find closest` [m]");
        option = true;
      }
    }
    for (std::int64_t i = 0; i < count; ++i) {
      input_.need([&] {
        return "interface node " + std::to_string(i + 1) + " of " + std::to_string(count) +
               ": the label of a finite element node or `find closest`";
      });
      read_interface(tolerance);
    }
  }

  void read_interface(double tolerance) {
    const SourcePosition where = input_.where();
    std::optional<Eigen::Index> point;
    if (input_.take("find closest")) {
      if (input_.more() && input_.take("interface tolerance")) {
        tolerance = input_.positive("the tolerance of `find closest` [m]");
      }
    } else {
      point = find(where, fem_label("the label of a finite element node"));
    }
    ModalInterface out;
    const End end = read_end(context_);
    out.node = end.node;
    if (joint_.node && out.node == *joint_.node) {
      fail(where, "the interface is on the modal node that carries the body");
    }
    out.o = read_position(context_, end.place());
    if (input_.more() && input_.take("orientation")) {
      if (!read_orientation(context_, end.place()).isIdentity(1e-15)) {
        input_.diagnostics().warning(where, "the orientation of an interface has no effect, as in MBDyn");
      }
    }
    if (input_.more()) skip_output(input_);
    if (!point) point = closest(where, end.frame.x + end.frame.R * out.o, tolerance);
    const auto i = static_cast<std::size_t>(*point);
    out.label = file_.labels[i];
    out.p = file_.points.col(*point);
    out.T = shapes_[i].topRows<3>();
    out.Q = shapes_[i].bottomRows<3>();
    joint_.interfaces.push_back(std::move(out));
  }

  /// A label of the file, quoted or not.
  std::string fem_label(const char* what) {
    input_.need(what);
    if (auto text = input_.take_string()) return *std::move(text);
    const SourcePosition where = input_.where();
    if (input_.at_words()) {
      const std::string text(input_.peek_text());
      std::string spelled;
      for (const char c : text) spelled += lower(c);
      if (!input_.take(spelled.c_str())) fail(where, "found " + quoted(text) + ", expected " + what);
      return text;
    }
    return std::to_string(input_.integer(what));
  }

  Eigen::Index find(const SourcePosition& where, const std::string& label) {
    const auto begin = file_.labels.begin(), end = file_.labels.end();
    const auto found = std::find(begin, end, label);
    const std::string file = quoted(input_.diagnostics().files()[static_cast<std::size_t>(file_index_)]);
    if (found == end) fail(where, "found the node " + quoted(label) + ", " + file + " has none of that label");
    if (std::find(found + 1, end, label) != end) {
      fail(where, file + " has two nodes of the label " + quoted(label));
    }
    return found - begin;
  }

  Eigen::Index closest(const SourcePosition& where, const Vec3& point, double tolerance) {
    const Frame body = carrier();
    Eigen::Index best = 0;
    const Vec3 seen = body.R.transpose() * (point - body.x);
    const double distance = (file_.points.colwise() - seen).colwise().norm().minCoeff(&best);
    if (!(distance <= tolerance)) {
      fail(where, "the closest finite element node, " + quoted(file_.labels[static_cast<std::size_t>(best)]) + ", is " +
                      number_text(distance) + " m away, the tolerance is " + number_text(tolerance) +
                      " m: name the node, or give an `interface tolerance`");
    }
    return best;
  }

  Frame carrier() const {
    if (joint_.node) return context_.frame(*joint_.node);
    Frame frame;
    frame.x = joint_.x;
    frame.R = joint_.R;
    return frame;
  }

  // ---- from the modes of the file to those in use
  void select() {
    if (list_.empty()) {
      for (int k = 1; k <= m_; ++k) joint_.numbers.push_back(k);
    } else {
      for (const std::int64_t k : list_) joint_.numbers.push_back(static_cast<int>(k));
    }
    std::vector<int> kept;
    for (const int k : joint_.numbers) kept.push_back(k - 1);
    joint_.M = file_.M(kept, kept);
    joint_.K = file_.K(kept, kept);
    if (file_.C) joint_.C = (*file_.C)(kept, kept);
    set_damping();
    cut(joint_.M, thresholds_.M);
    cut(joint_.C, thresholds_.C);
    cut(joint_.K, thresholds_.K);
    for (const Eigen::MatrixXd& shape : file_.shape) shapes_.emplace_back(shape(Eigen::all, kept));

    joint_.a = file_.a(kept);
    joint_.b = file_.adot(kept);
    if (initial_) set_initial_values();

    joint_.inertia = modal_inertia(file_, kept, shapes_, origin_);
    file_.points.colwise() -= origin_;
  }

  void set_damping() {
    using Kind = Damping::Kind;
    const Eigen::VectorXd critical = 2.0 * (joint_.K.diagonal().cwiseProduct(joint_.M.diagonal())).cwiseSqrt();
    switch (damping_.kind) {
      case Kind::none:
        joint_.C.setZero(m_, m_);
        break;
      case Kind::unsaid:
        if (!file_.C) joint_.C.setZero(m_, m_);
        break;
      case Kind::file:
        if (!file_.C) {
          fail(damping_.where, "`damping from file` needs record group 13 (modal damping matrix), which " +
                                   quoted(input_.diagnostics().files()[static_cast<std::size_t>(file_index_)]) +
                                   " does not have");
        }
        break;
      case Kind::single:
        damping_.ratios.setConstant(m_, damping_.factor);
        [[fallthrough]];
      case Kind::diagonal:
        joint_.C.setZero(m_, m_);
        for (int k = 0; k < m_; ++k) {
          if (damping_.ratios(k) == 0.0) continue;
          joint_.C(k, k) = damping_.ratios(k) * critical(k);
          if (std::isfinite(joint_.C(k, k))) continue;
          fail(damping_.where, "mode " + std::to_string(joint_.numbers[static_cast<std::size_t>(k)]) +
                                   " has a negative stiffness, " + number_text(joint_.K(k, k)) +
                                   ": a damping ratio means nothing for it");
        }
        break;
      case Kind::rayleigh:
        joint_.C = damping_.alpha * joint_.M + damping_.beta * joint_.K;
        break;
    }
  }

  void set_initial_values() {
    joint_.a.setZero();
    joint_.b.setZero();
    for (const InitialValue& value : values_) {
      int place = 0;
      if (value.mode != 0 || value.where.line != 0) {
        const auto found = std::find(joint_.numbers.begin(), joint_.numbers.end(), value.mode);
        if (found == joint_.numbers.end()) {
          fail(value.where,
               "found mode " + std::to_string(value.mode) + ", which is not in use here: modes count as in the file");
        }
        place = static_cast<int>(found - joint_.numbers.begin());
      }
      joint_.a(place) = value.a;
      joint_.b(place) = value.b;
    }
  }

  void use_invariant_9(const SourcePosition& where) {
    if (!file_.lumped && !file_.I9) {
      fail(where, "`use invariant 9` needs record group 11 (lumped masses), which " +
                      quoted(input_.diagnostics().files()[static_cast<std::size_t>(file_index_)]) + " does not have");
    }
    std::vector<int> kept;
    for (const int k : joint_.numbers) kept.push_back(k - 1);
    joint_.inertia.I9 = modal_invariant_9(file_, kept, shapes_);
  }

  Context& context_;
  Input& input_;
  ModalData joint_;
  FemFile file_;
  int file_index_ = 0, m_ = 0;
  SourcePosition modes_where_, count_where_;
  std::vector<std::int64_t> list_;
  std::vector<SourcePosition> list_where_;
  bool initial_ = false;
  std::vector<InitialValue> values_;
  std::optional<std::int64_t> count_;
  Damping damping_;
  Thresholds thresholds_;
  Vec3 origin_ = Vec3::Zero();
  std::vector<Eigen::MatrixXd> shapes_;  ///< per node 6 x modes in use
};

}  // namespace

ModalData read_modal(Context& context) { return ModalReader(context).read(); }

}  // namespace mbdae::reading
