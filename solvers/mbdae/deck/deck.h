// What a deck says, once read: plain data, no syntax, no mechanics.
//
// The reader (deck/) fills these structures and resolves everything that the input language resolves while reading:
// expressions, reference frames, labels. Every offset and orientation below is expressed in the frame of the node it
// belongs to, every node pose and velocity in the global frame. The mechanics (model/) builds its elements from them.
// SI units throughout: m, kg, s, N, N m, rad.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <any>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "mbdae/deck/element_type.h"
#include "mbdae/drive/drive.h"
#include "mbdae/drive/signal.h"

namespace mbdae {

using Vec3 = Eigen::Vector3d;
using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat3 = Eigen::Matrix3d;
using Mat6 = Eigen::Matrix<double, 6, 6>;

/// Where a card stands in the input: index into Deck::files, line and column counted from 1.
struct SourcePosition {
  int file = 0;
  int line = 0;
  int column = 0;
};

/// Index of a node in Deck::nodes.
using NodeIndex = std::size_t;

/// A label and the name it goes by.
///
/// The name is the lower-case identifier when the label was written as a named constant (`HAND_L` -> "hand_l"),
/// otherwise "node 3", "joint 101", "body 5", ...
struct Identity {
  std::uint32_t label = 0;
  std::string name;
  SourcePosition where;
};

// ---- nodes -------------------------------------------------------------------------------------------------------

enum class NodeKind { dynamic_node, static_node, modal_node };

/// A structural node. Dummy nodes own no unknowns: they are kept in Deck::dummy_nodes for output only.
struct NodeData {
  Identity id;
  NodeKind kind = NodeKind::dynamic_node;  ///< as the deck says; `model: static` is Deck::control.static_model
  Vec3 x = Vec3::Zero();                   ///< position, global [m]
  Mat3 R = Mat3::Identity();               ///< orientation, columns = node axes in global components
  Vec3 v = Vec3::Zero();                   ///< velocity, global [m/s]
  Vec3 w = Vec3::Zero();                   ///< absolute angular velocity, global components [rad/s]
};

struct DummyNodeData {
  Identity id;
  NodeIndex base = 0;                    ///< whose motion it shows
  std::optional<NodeIndex> relative_to;  ///< seen from this node (`relative frame`)
  Vec3 offset = Vec3::Zero();            ///< in the base node's frame [m]
  Mat3 rotation = Mat3::Identity();      ///< relative to the base node
};

/// An abstract node: one unknown, and one equation that is empty until elements write into it.
struct AbstractNodeData {
  Identity id;
  bool differential = true;  ///< otherwise algebraic: its value has no rate
  double value = 0.0, rate = 0.0;
};

/// A degree of freedom of a node, or the equation that belongs to it.
struct DofData {
  bool structural = false;  ///< of Deck::nodes, otherwise of Deck::abstract_nodes
  std::size_t node = 0;
  int component = 0;  ///< of a structural node: 0, 1, 2 along x, y, z; 3, 4, 5 about them
  bool rate = false;  ///< the `differential` order: the velocity, or the rate of the value
};

/// A function of one number from a `scalar function` card, with its derivative.
class ScalarFunction {
 public:
  virtual ~ScalarFunction() = default;
  virtual double value(double x) const = 0;
  virtual double slope(double x) const = 0;
};
using ScalarFunctionPtr = std::shared_ptr<const ScalarFunction>;

// ---- constitutive laws -------------------------------------------------------------------------------------------
// N = 1, 3 or 6 components; N = 1 uses 1x1 Eigen types so that one template serves all.

/// f = prestress + K (eps - prestrain(t)) + C epsdot
template <int N>
struct LinearLaw {
  Eigen::Matrix<double, N, N> K = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, N> C = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, 1> prestress = Eigen::Matrix<double, N, 1>::Zero();
  VectorDrive<N> prestrain;
};

/// Component by component: f = prestress + K1 e + K2 |e| e + K3 e^3 (+ C epsdot), e = eps - prestrain(t). N = 1, 3.
template <int N>
struct CubicLaw {
  Eigen::Matrix<double, N, 1> K1, K2, K3;
  Eigen::Matrix<double, N, N> C = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, 1> prestress = Eigen::Matrix<double, N, 1>::Zero();
  VectorDrive<N> prestrain;
};

enum class MuscleModel { pennestri, erf };
enum class ShortRangeModel { exponential, linear };

/// Reflex a = a0 + Kp (x - x_ref) + Kd v. Gains and reference length are drives (functions of time).
struct ReflexData {
  DrivePtr proportional_gain;  ///< Kp [-]
  DrivePtr derivative_gain;    ///< Kd [-]
  DrivePtr reference_length;   ///< l_ref [m]; x_ref = l_ref / L0
};

struct ShortRangeData {
  ShortRangeModel model = ShortRangeModel::exponential;
  double gamma = 280.0;
  double delta = 5.7e-3;
};

/// Muscle law of a rod: f = prestress + F0 (f1(x) f2(v) a + f3(x)), x = (Li/L0)(1 + eps - prestrain), v = (Li/V0)
/// epsdot.
struct MuscleLaw {
  MuscleModel model = MuscleModel::pennestri;
  double Li = 0.0;  ///< initial length [m]
  double L0 = 0.0;  ///< reference (optimal) length [m]
  double V0 = 0.0;  ///< reference velocity [m/s]
  double F0 = 0.0;  ///< reference force [N]
  DrivePtr activation;
  bool activation_check = false;  ///< clip a to [0, 1]
  bool ergonomy = false;          ///< evaluate at zero velocity
  std::optional<ReflexData> reflex;
  std::optional<ShortRangeData> short_range;
  double prestress = 0.0;  ///< [N]
  DrivePtr prestrain;      ///< null pointer = none
};

/// Component by component: f = prestress + F(eps - prestrain(t)). N = 1, 3.
template <int N>
struct FunctionLaw {
  std::array<ScalarFunctionPtr, N> elastic;  ///< F of each component; null = zero
  Eigen::Matrix<double, N, N> C = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, 1> prestress = Eigen::Matrix<double, N, 1>::Zero();
  VectorDrive<N> prestrain;
};

using Law1 = std::variant<LinearLaw<1>, CubicLaw<1>, FunctionLaw<1>, MuscleLaw>;
using Law3 = std::variant<LinearLaw<3>, CubicLaw<3>, FunctionLaw<3>>;
using Law6 = std::variant<LinearLaw<6>>;

// ---- elements ----------------------------------------------------------------------------------------------------

/// An element: what its card says, as the reader of its type (elements/) has it.
struct ElementData {
  Identity id;
  const ElementType* type = nullptr;  ///< row of the table of elements
  std::any data;                      ///< ClampData, RodData, ...
  DrivePtr driver = {};               ///< of a driven element: it is there while this is not zero; null = always

  /// The data, whose type must be the row's.
  template <class Data>
  const Data& as() const {
    return *std::any_cast<Data>(&data);
  }
  template <class Data>
  Data& as() {
    return *std::any_cast<Data>(&data);
  }
  /// The data if they are of this type, else null.
  template <class Data>
  const Data* get_if() const {
    return std::any_cast<Data>(&data);
  }
};

// ---- bodies ------------------------------------------------------------------------------------------------------

struct BodyData {
  Identity id;
  NodeIndex node = 0;
  double m = 0.0;            ///< [kg]
  Vec3 d = Vec3::Zero();     ///< centre of mass in the node frame [m]
  Mat3 J_cm = Mat3::Zero();  ///< inertia about the centre of mass, node axes [kg m^2]
};

// ---- analysis ----------------------------------------------------------------------------------------------------

struct EigenanalysisData {
  std::vector<double> times;  ///< [s]
  double parameter = 1.0;     ///< c = parameter / 2 [s]
  bool has_parameter = false;
  double upper_frequency = 0.0;  ///< [Hz], gives the parameter where the deck does not; 0 = none
  SourcePosition where;
};

enum class MethodKind { ms, implicit_euler, crank_nicolson, other };

struct InitialValueData {
  /// [s]; final_time may be infinite (`forever`), time_step is 0 where the deck has none
  double initial_time = 0.0, final_time = 0.0, time_step = 0.0;
  MethodKind method = MethodKind::ms;
  std::string method_text;                ///< as written, for messages
  double rho = 0.0, rho_algebraic = 0.0;  ///< asymptotic spectral radii of `ms`
  double tolerance = 1e-6;
  int max_iterations = 20;
  double derivatives_tolerance = 1e-6;
  int derivatives_max_iterations = 20;
  double derivatives_coefficient = 1e-6;
  std::optional<EigenanalysisData> eigenanalysis;
};

struct ControlData {
  bool static_model = false;
  bool skip_initial_joint_assembly = false;
};

struct Deck {
  std::vector<std::string> files;  ///< files[0] = the deck, then includes in order of appearance
  InitialValueData initial_value;
  ControlData control;
  std::vector<NodeData> nodes;  ///< in deck order: the order of the unknowns
  std::vector<DummyNodeData> dummy_nodes;
  std::vector<AbstractNodeData> abstract_nodes;  ///< in deck order: their unknowns follow those of structural nodes
  std::vector<BodyData> bodies;
  std::vector<ElementData> joints;                     ///< in deck order, rods and deformable elements included
  std::vector<ElementData> genels;                     ///< in deck order
  std::vector<ElementData> forces;                     ///< forces and couples in deck order
  std::vector<std::shared_ptr<const Signal>> signals;  ///< what drives read of the state
  std::optional<VectorDrive<3>> gravity;               ///< uniform acceleration [m/s^2], global components
  std::vector<DrivePtr> pieced_drives;                 ///< drives whose value or derivatives jump somewhere
};

}  // namespace mbdae
