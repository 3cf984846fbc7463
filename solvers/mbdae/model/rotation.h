// Rotations: exponential, logarithm, their tangent maps, and the Cayley-Gibbs-Rodrigues increments of the unknowns.
//
// With theta a rotation vector [rad]: d exp(theta x) = (Gamma(theta) dtheta) x exp(theta x). Sources: standard results
// on the rotation group; every function is checked against finite differences in tests/test_model_rotation.cpp.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace mbdae {

/// Matrix of the cross product: skew(a) b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

/// skew(a) skew(b) without forming either.
inline Eigen::Matrix3d skew_skew(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  Eigen::Matrix3d m = b * a.transpose();
  m.diagonal().array() -= a.dot(b);
  return m;
}

/// Rotation matrix of the rotation vector theta [rad].
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& theta);

/// Rotation vector of R, norm in [0, pi] rad. Accurate near 0 and near pi.
Eigen::Vector3d rotation_log(const Eigen::Matrix3d& R);

/// Gamma(theta): d exp(theta x) = (Gamma dtheta) x exp(theta x).
Eigen::Matrix3d rotation_gamma(const Eigen::Vector3d& theta);

/// Inverse of Gamma(theta); |theta| < 2 pi.
Eigen::Matrix3d rotation_gamma_inverse(const Eigen::Vector3d& theta);

/// Matrix of dtheta -> d(Gamma(theta)) a, i.e. the derivative of Gamma(theta) a for constant a.
Eigen::Matrix3d rotation_gamma_derivative(const Eigen::Vector3d& theta, const Eigen::Vector3d& a);

/// Matrix of dtheta -> d(Gamma(theta)^-1) a.
Eigen::Matrix3d rotation_gamma_inverse_derivative(const Eigen::Vector3d& theta, const Eigen::Vector3d& a);

/// Rotation matrix of Cayley-Gibbs-Rodrigues parameters g (g = 2 tan(angle/2) times the axis).
Eigen::Matrix3d cayley_rotation(const Eigen::Vector3d& g);

/// G(g) of Cayley-Gibbs-Rodrigues parameters: angular velocity = G(g) gdot, dR = (G(g) dg) x R.
Eigen::Matrix3d cayley_tangent(const Eigen::Vector3d& g);

/// Derivative of G(g) gdot with respect to g.
Eigen::Matrix3d cayley_rate_derivative(const Eigen::Vector3d& g, const Eigen::Vector3d& gdot);

/// Parameters g of the rotation matrix R; the angle must be below pi.
Eigen::Vector3d cayley_parameters(const Eigen::Matrix3d& R);

/// Unit quaternion (w, x, y, z) with w >= 0 of a rotation matrix.
Eigen::Vector4d quaternion_of(const Eigen::Matrix3d& R);

/// Rotation matrix of a quaternion (w, x, y, z) of any nonzero norm.
Eigen::Matrix3d rotation_of_quaternion(const Eigen::Vector4d& q);

}  // namespace mbdae
