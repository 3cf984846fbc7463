// The modal joint: tangents in any state, a body of masses and springs against the same in modes, energy in motion.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/analyses.h"
#include "mbdae/elements/modal_inertia.h"
#include "pencil.h"
#include "tangent_check.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

// A body of `nodes` random masses in `modes` random shapes: no symmetry anywhere, matrices full.
FemFile random_body(Ugly& ugly, int nodes, int modes) {
  FemFile file;
  file.nodes = nodes;
  file.modes = modes;
  file.points.resize(3, nodes);
  Eigen::Matrix4Xd lumped(4, nodes);
  for (int i = 0; i < nodes; ++i) {
    file.labels.push_back(std::to_string(i + 1));
    file.points.col(i) = ugly.vector();
    lumped.col(i) << ugly.number(0.2, 1.0), ugly.number(0.05, 0.2), ugly.number(0.05, 0.2), ugly.number(0.05, 0.2);
    Eigen::MatrixXd shape(6, modes);
    for (int j = 0; j < 6; ++j) {
      for (int k = 0; k < modes; ++k) shape(j, k) = 0.1 * ugly.number();
    }
    file.shape.push_back(shape);
  }
  file.lumped = lumped;
  const auto matrix = [&] {
    Eigen::MatrixXd A(modes, modes);
    for (int j = 0; j < modes; ++j) {
      for (int k = 0; k < modes; ++k) A(j, k) = ugly.number();
    }
    return A;
  };
  const Eigen::MatrixXd A = matrix();
  file.M = A * A.transpose() + Eigen::MatrixXd::Identity(modes, modes);
  file.K = 30.0 * matrix();
  file.C = matrix();
  return file;
}

ModalData modal_data(const FemFile& file, bool second_order) {
  ModalData data;
  std::vector<int> kept;
  for (int k = 0; k < file.modes; ++k) {
    kept.push_back(k);
    data.numbers.push_back(k + 1);
  }
  data.M = file.M;
  data.C = *file.C;
  data.K = file.K;
  data.a.setZero(file.modes);
  data.b.setZero(file.modes);
  data.inertia = modal_inertia(file, kept, file.shape, Vec3::Zero());
  if (second_order) data.inertia.I9 = modal_invariant_9(file, kept, file.shape);
  return data;
}

void add_interface(ModalData& data, const FemFile& file, int i, NodeIndex node, const Vec3& offset) {
  ModalInterface interface;
  interface.node = node;
  interface.label = file.labels[static_cast<std::size_t>(i)];
  interface.p = file.points.col(i);
  interface.T = file.shape[static_cast<std::size_t>(i)].topRows<3>();
  interface.Q = file.shape[static_cast<std::size_t>(i)].bottomRows<3>();
  interface.o = offset;
  data.interfaces.push_back(interface);
}

// Interfaces at nodes 1 and 2, dynamic and static, with offsets; forces on two modes; gravity that no axis lies along.
Deck with_interfaces(unsigned seed, const FemFile& file, ModalData data, bool free) {
  Ugly ugly(seed);
  Deck deck;
  const NodeIndex end1 =
      add_node(deck, NodeKind::dynamic_node, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.vector());
  add_body(deck, end1, 0.7, ugly.vector(0.2), ugly.inertia());
  const NodeIndex end2 =
      add_node(deck, NodeKind::static_node, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.vector());
  if (free) {
    data.node = add_node(deck, NodeKind::modal_node, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.vector());
    add_body(deck, *data.node, 0.4, ugly.vector(0.2), ugly.inertia());
  } else {
    data.x = ugly.vector();
    data.R = ugly.rotation();
  }
  for (Eigen::Index k = 0; k < data.a.size(); ++k) {
    data.a(k) = ugly.number();
    data.b(k) = ugly.number();
  }
  add_interface(data, file, 0, end1, ugly.vector(0.3));
  add_interface(data, file, 1, end2, ugly.vector(0.3));
  add_joint(deck, data);
  ModalForceData force;
  force.terms = {{0, sine(1.0, 0.5, 2.0)}, {1, constant(0.3)}};
  deck.forces.push_back({identity(301, "force_301"), element_type<ModalForceData>(), force});
  add_gravity(deck, Vec3(0.3, -9.81, 0.7));
  return deck;
}

}  // namespace

TEST_CASE("modal joint on a modal node: tangents far from anything") {
  Ugly ugly(1);
  const FemFile file = random_body(ugly, 4, 5);
  check_tangents(with_interfaces(2, file, modal_data(file, false), true), 3);
}

TEST_CASE("modal joint with the second-order moments of mass") {
  Ugly ugly(4);
  const FemFile file = random_body(ugly, 3, 4);
  check_tangents(with_interfaces(5, file, modal_data(file, true), true), 6);
}

TEST_CASE("modal joint on the ground") {
  Ugly ugly(7);
  const FemFile file = random_body(ugly, 3, 4);
  check_tangents(with_interfaces(8, file, modal_data(file, false), false), 9);
}

TEST_CASE("modal joint without coupling of rigid and modal motion") {
  Ugly ugly(10);
  FemFile file = random_body(ugly, 3, 4);
  file.lumped.reset();
  file.rigid = FemRigidBody{2.0, ugly.vector(0.3), ugly.inertia()};
  check_tangents(with_interfaces(11, file, modal_data(file, false), true), 12);
}

TEST_CASE("modal joint beside other joints: files have the unknowns in deck order") {
  Ugly ugly(13);
  const FemFile file = random_body(ugly, 3, 4);
  Deck deck;
  const NodeIndex carrier = add_node(deck, NodeKind::modal_node, Vec3(0.1, 0.2, 0.3), ugly.rotation());
  add_joint(deck, clamp(deck, carrier));
  ModalData data = modal_data(file, false);
  data.node = carrier;
  data.a(1) = 0.25;
  add_joint(deck, data);
  deck.joints.push_back(deck.joints.front());
  const LinearisedModel model = linearise(deck, {});
  REQUIRE(model.y.size() == 12 + 6 + 8 + 6);
  CHECK(model.dofs[6].kind == "velocity");
  CHECK(model.dofs[9].name == "node_1.wx");
  CHECK(model.dofs[12].name == "joint_101.reaction[1]");
  CHECK(model.dofs[18].name == "joint_102.a[1]");
  CHECK(model.dofs[19].kind == "modal_displacement");
  CHECK(model.dofs[22].kind == "modal_velocity");
  CHECK(model.dofs[26].name == "joint_101.reaction[1]");
  REQUIRE(model.joints.size() == 3);
  CHECK(model.joints[1].first == 18);
  CHECK(model.joints[1].dofs == 8);
  CHECK(model.joints[2].first == 26);
  CHECK(model.y(19) == 0.25);
}

// Two masses on springs along a line through a frame that the ground holds; interface at the second, with a body on it.
TEST_CASE("modal joint: frequencies of masses on springs") {
  FemFile file;
  file.nodes = 2;
  file.modes = 2;
  file.labels = {"1", "2"};
  file.points = Eigen::Matrix3Xd::Zero(3, 2);
  file.points(0, 1) = 0.5;
  for (int i = 0; i < 2; ++i) {
    Eigen::MatrixXd shape = Eigen::MatrixXd::Zero(6, 2);
    shape(0, i) = 1.0;
    file.shape.push_back(shape);
  }
  const double m1 = 2.0, m2 = 3.0, k1 = 400.0, k2 = 700.0, tip = 1.5;
  Eigen::Matrix4Xd lumped = Eigen::Matrix4Xd::Zero(4, 2);
  lumped(0, 0) = m1;
  lumped(0, 1) = m2;
  file.lumped = lumped;
  file.M = Eigen::Vector2d(m1, m2).asDiagonal();
  file.K = (Eigen::Matrix2d() << k1 + k2, -k2, -k2, k2).finished();
  file.C = Eigen::Matrix2d::Zero();
  Deck deck;
  const NodeIndex end = add_node(deck, NodeKind::dynamic_node, Vec3(0.5, 0.0, 0.0));
  add_body(deck, end, tip, Vec3::Zero(), Mat3::Identity());
  ModalData data = modal_data(file, false);
  add_interface(data, file, 1, end, Vec3::Zero());
  add_joint(deck, data);
  const LinearisedModel model = linearise(deck, {});

  // (K - omega^2 M) v = 0: M1 M2 omega^4 - (K11 M2 + K22 M1) omega^2 + det K = 0
  const double M1 = m1, M2 = m2 + tip, a = M1 * M2, b = (k1 + k2) * M2 + k2 * M1, c = k1 * k2;
  for (const double sign : {-1.0, 1.0}) {
    const double omega = std::sqrt((b + sign * std::sqrt(b * b - 4.0 * a * c)) / (2.0 * a));
    CHECK(distance_to_eigenvalue(model, {0.0, omega}) / omega < 1e-9);
  }
}

namespace {

double channel(const Motion& motion, const std::string& name, Eigen::Index row) {
  for (std::size_t i = 0; i < motion.channels.size(); ++i) {
    if (motion.channels[i].name == name) return motion.data(row, static_cast<Eigen::Index>(i));
  }
  FAIL("no channel " << name);
  return 0.0;
}

// A free body that tumbles and vibrates, its shapes those of two masses on springs in its frame: linear and angular
// momentum about the origin stay what they were (no moments of inertia of the nodes).
Deck tumbling_body() {
  Ugly ugly(21);
  FemFile file = random_body(ugly, 4, 3);
  file.lumped->bottomRows<3>().setZero();
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(3, 3);
  for (int i = 0; i < 4; ++i) {
    const auto T = file.shape[static_cast<std::size_t>(i)].topRows<3>();
    M += (*file.lumped)(0, i) * T.transpose() * T;
  }
  file.M = M;
  file.K = 900.0 * M;
  file.C = Eigen::MatrixXd::Zero(3, 3);
  ModalData data = modal_data(file, true);
  Deck deck;
  data.node =
      add_node(deck, NodeKind::modal_node, Vec3(0.1, 0.2, 0.3), ugly.rotation(), ugly.vector(), ugly.vector(2.0));
  data.a << 0.2, -0.1, 0.15;
  data.b << 1.0, -2.0, 0.5;
  add_joint(deck, data);
  deck.initial_value.final_time = 0.5;
  deck.initial_value.time_step = 1e-3;
  deck.initial_value.tolerance = 1e-10;
  return deck;
}

struct Momenta {
  Vec3 linear = Vec3::Zero(), angular = Vec3::Zero();
  double energy = 0.0;
};

// Of the masses themselves, not by the sums that the element uses.
Momenta momenta(const Deck& deck, const FemFile& file, const Motion& motion, Eigen::Index row) {
  const auto vector = [&](const char* stem) {
    Vec3 out;
    for (int k = 0; k < 3; ++k) out(k) = channel(motion, std::string("node_1.") + stem + "xyz"[k], row);
    return out;
  };
  const auto& data = deck.joints.front().as<ModalData>();
  Eigen::Vector3d a, b;
  for (int k = 0; k < 3; ++k) {
    a(k) = channel(motion, "joint_101.a[" + std::to_string(k + 1) + "]", row);
    b(k) = channel(motion, "joint_101.b[" + std::to_string(k + 1) + "]", row);
  }
  const Vec3 x = vector(""), v = vector("v"), w = vector("w");
  const Mat3 R = rotation_exp(vector("g"));
  Momenta out;
  for (int i = 0; i < 4; ++i) {
    const auto T = file.shape[static_cast<std::size_t>(i)].topRows<3>();
    const Vec3 arm = R * (file.points.col(i) + T * a), speed = v + w.cross(arm) + R * (T * b);
    const double m = (*file.lumped)(0, i);
    out.linear += m * speed;
    out.angular += m * (x + arm).cross(speed);
    out.energy += 0.5 * m * speed.squaredNorm();
  }
  out.energy += 0.5 * a.dot(data.K * a);
  return out;
}

}  // namespace

TEST_CASE("modal joint in free motion keeps momentum, angular momentum and energy") {
  const Deck deck = tumbling_body();
  Ugly ugly(21);
  FemFile file = random_body(ugly, 4, 3);  // the same numbers again
  file.lumped->bottomRows<3>().setZero();
  for (const std::string integrator : {"ida", "ms"}) {
    IntegrateOptions options;
    options.integrator = integrator;
    options.rtol = 1e-10;
    options.atol = 1e-12;
    const Motion motion = integrate(deck, options);
    const Momenta start = momenta(deck, file, motion, 0);
    const Momenta end = momenta(deck, file, motion, motion.data.rows() - 1);
    INFO(integrator);
    const double tolerance = integrator == "ida" ? 1e-7 : 2e-3;  // the fixed-step formula dissipates
    CHECK((end.linear - start.linear).norm() < tolerance * start.linear.norm());
    CHECK((end.angular - start.angular).norm() < tolerance * start.angular.norm());
    CHECK(std::abs(end.energy - start.energy) < tolerance * start.energy);
  }
}

TEST_CASE("modal joints and nodes have no place in a static deck") {
  Ugly ugly(31);
  const FemFile file = random_body(ugly, 2, 2);
  Deck deck = with_interfaces(
      32, file,
      [&] {
        ModalData data = modal_data(file, false);
        return data;
      }(),
      false);
  deck.control.static_model = true;
  CHECK_THROWS_AS(solve_static(deck, {}), ModelError);
}

TEST_CASE("an interface turned the other way is refused") {
  Ugly ugly(33);
  const FemFile file = random_body(ugly, 2, 2);
  Deck deck;
  const NodeIndex end =
      add_node(deck, NodeKind::dynamic_node, file.points.col(0), rotation_exp(Vec3(0.0, 0.0, 3.14159265358979)));
  ModalData data = modal_data(file, false);
  add_interface(data, file, 0, end, Vec3::Zero());
  add_joint(deck, data);
  CHECK_THROWS_WITH(linearise(deck, {}), Catch::Contains("more than 90 deg"));
}
