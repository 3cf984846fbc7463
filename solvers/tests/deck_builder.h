// Decks made in C++ for tests of the mechanics: short helpers, "ugly" inertias, offsets and frames.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <memory>
#include <random>
#include <string>

#include "mbdae/deck/deck.h"
#include "mbdae/elements/deformable_axial_joint.h"
#include "mbdae/elements/deformable_displacement_joint.h"
#include "mbdae/elements/deformable_hinge.h"
#include "mbdae/elements/deformable_joint.h"
#include "mbdae/elements/force.h"
#include "mbdae/elements/hinge.h"
#include "mbdae/elements/invariant_deformable_hinge.h"
#include "mbdae/elements/rod.h"
#include "mbdae/elements/table.h"
#include "mbdae/elements/total.h"
#include "mbdae/model/rotation.h"

namespace mbdae::test {

inline DrivePtr constant(double value) { return std::make_shared<ConstDrive>(value); }

/// A drive with known derivatives: A0 + A1 sin(w t + p).
class SineDrive final : public Drive {
 public:
  SineDrive(double offset, double amplitude, double omega, double phase)
      : offset_(offset), amplitude_(amplitude), omega_(omega), phase_(phase) {}
  Jet at(double t) const override {
    const double s = std::sin(omega_ * t + phase_), c = std::cos(omega_ * t + phase_);
    return {offset_ + amplitude_ * s, amplitude_ * omega_ * c, -amplitude_ * omega_ * omega_ * s};
  }

 private:
  double offset_, amplitude_, omega_, phase_;
};

inline DrivePtr sine(double offset, double amplitude, double omega, double phase = 0.0) {
  return std::make_shared<SineDrive>(offset, amplitude, omega, phase);
}

template <int N>
VectorDrive<N> vector_drive(const Eigen::Matrix<double, N, 1>& direction, DrivePtr drive = constant(1.0)) {
  VectorDrive<N> out;
  out.terms.push_back({direction, std::move(drive)});
  return out;
}

inline Identity identity(std::uint32_t label, std::string name) {
  Identity id;
  id.label = label;
  id.name = std::move(name);
  return id;
}

/// Adds a node and returns its index.
inline NodeIndex add_node(Deck& deck, NodeKind kind, const Vec3& x, const Mat3& R = Mat3::Identity(),
                          const Vec3& v = Vec3::Zero(), const Vec3& w = Vec3::Zero()) {
  NodeData node;
  const auto label = static_cast<std::uint32_t>(deck.nodes.size() + 1);
  node.id = identity(label, "node_" + std::to_string(label));
  node.kind = kind;
  node.x = x;
  node.R = R;
  node.v = v;
  node.w = w;
  deck.nodes.push_back(node);
  return deck.nodes.size() - 1;
}

inline void add_body(Deck& deck, NodeIndex node, double m, const Vec3& d, const Mat3& J_cm) {
  BodyData body;
  const auto label = static_cast<std::uint32_t>(deck.bodies.size() + 1);
  body.id = identity(label, "body_" + std::to_string(label));
  body.node = node;
  body.m = m;
  body.d = d;
  body.J_cm = J_cm;
  deck.bodies.push_back(body);
}

template <class Data>
void add_joint(Deck& deck, const Data& data) {
  const auto label = static_cast<std::uint32_t>(101 + deck.joints.size());
  deck.joints.push_back({identity(label, "joint_" + std::to_string(label)), element_type<Data>(), data});
}

inline void add_force(Deck& deck, const ForceData& force) {
  const auto label = static_cast<std::uint32_t>(201 + deck.forces.size());
  deck.forces.push_back({identity(label, "force_" + std::to_string(label)), element_type<ForceData>(), force});
}

inline void add_gravity(Deck& deck, const Vec3& acceleration) { deck.gravity = vector_drive<3>(acceleration); }

inline ClampData clamp(const Deck& deck, NodeIndex node) {
  return {node, deck.nodes[node].x, deck.nodes[node].R, std::nullopt};
}

/// Random numbers for geometry that nothing lines up with; same numbers every run.
class Ugly {
 public:
  explicit Ugly(unsigned seed) : engine_(seed) {}
  double number(double from = -1.0, double to = 1.0) {
    return std::uniform_real_distribution<double>(from, to)(engine_);
  }
  Vec3 vector(double size = 1.0) { return Vec3(number(-size, size), number(-size, size), number(-size, size)); }
  Mat3 rotation(double size = 2.0) { return rotation_exp(vector(size)); }
  template <int N>
  Eigen::Matrix<double, N, N> matrix(double size = 1.0) {
    Eigen::Matrix<double, N, N> m;
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j < N; ++j) m(i, j) = number(-size, size);
    }
    return m;
  }
  Mat3 inertia(double size = 0.1) {
    const Mat3 m = matrix<3>();
    return size * (m * m.transpose() + Mat3::Identity());
  }

 private:
  std::mt19937 engine_;
};

}  // namespace mbdae::test
