// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/modal_inertia.h"

#include "mbdae/model/rotation.h"

namespace mbdae {

namespace {

/// Sums over the nodes (group 11).
void add_lumped(const FemFile& file, const std::vector<Eigen::MatrixXd>& shapes, const Vec3& origin,
                ModalInertia& out) {
  const Eigen::Index n = out.I3.cols();
  for (Eigen::Index i = 0; i < file.lumped->cols(); ++i) {
    const double m = (*file.lumped)(0, i);
    const Mat3 J = file.lumped->col(i).tail<3>().asDiagonal();
    const Vec3 p = file.points.col(i) - origin;
    const auto T = shapes[static_cast<std::size_t>(i)].topRows<3>();
    const auto Q = shapes[static_cast<std::size_t>(i)].bottomRows<3>();
    const Mat3 px = skew(p);
    out.I3 += m * T;
    out.I4 += m * px * T + J * Q;
    out.I11 += J * Q;
    for (Eigen::Index j = 0; j < n; ++j) {
      const Vec3 Tj = T.col(j), Qj = Q.col(j);
      out.I8[static_cast<std::size_t>(j)] -= m * skew_skew(p, Tj);
      out.I10[static_cast<std::size_t>(j)] += skew(Qj) * J;
      if (m == 0.0 || Tj.isZero(0.0)) continue;
      out.I5.middleCols(j * n, n) += m * skew(Tj) * T;
    }
  }
}

}  // namespace

ModalInertia modal_inertia(const FemFile& file, const std::vector<int>& kept,
                           const std::vector<Eigen::MatrixXd>& shapes, const Vec3& origin) {
  ModalInertia out;
  const auto n = static_cast<Eigen::Index>(kept.size());
  if (file.lumped) {
    for (Eigen::Index i = 0; i < file.lumped->cols(); ++i) {
      const double m = (*file.lumped)(0, i);
      const Vec3 p = file.points.col(i) - origin;
      out.m += m;
      out.S0 += m * p;
      out.J0 -= m * skew_skew(p, p);
      out.J0.diagonal() += file.lumped->col(i).tail<3>();
    }
  }
  if (file.rigid) {
    // The centre of mass is shifted only where it alone says what the body weighs, as in MBDyn.
    const Vec3 c = file.lumped ? file.rigid->c : Vec3(file.rigid->c - origin);
    out.m = file.rigid->m;
    out.S0 = out.m * c;
    out.J0 = file.rigid->J - out.m * skew_skew(c, c);
  }
  out.coupled = file.lumped || file.I3 || file.I4 || file.I8 || file.I5;
  if (!out.coupled) return out;
  out.I3.setZero(3, n);
  out.I4.setZero(3, n);
  out.I11.setZero(3, n);
  out.I5.setZero(3, n * n);
  out.I8.assign(kept.size(), Mat3::Zero());
  out.I10.assign(kept.size(), Mat3::Zero());
  if (file.lumped) add_lumped(file, shapes, origin, out);
  // Invariants of the file add to those of the masses, as in MBDyn.
  if (file.I3) out.I3 += (*file.I3)(Eigen::all, kept);
  if (file.I4) out.I4 += (*file.I4)(Eigen::all, kept);
  for (Eigen::Index j = 0; j < n; ++j) {
    const int from = kept[static_cast<std::size_t>(j)];
    if (file.I8) out.I8[static_cast<std::size_t>(j)] += file.I8->middleCols<3>(3 * from);
    if (!file.I5) continue;
    for (Eigen::Index k = 0; k < n; ++k) {
      out.I5.col(j * n + k) += file.I5->col(from * file.modes + kept[static_cast<std::size_t>(k)]);
    }
  }
  return out;
}

std::vector<Mat3> modal_invariant_9(const FemFile& file, const std::vector<int>& kept,
                                    const std::vector<Eigen::MatrixXd>& shapes) {
  const std::size_t n = kept.size();
  std::vector<Mat3> out(n * n, Mat3::Zero());
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t k = 0; k < n; ++k) {
      Mat3& sum = out[j * n + k];
      if (file.lumped) {
        for (Eigen::Index i = 0; i < file.lumped->cols(); ++i) {
          const Eigen::MatrixXd& shape = shapes[static_cast<std::size_t>(i)];
          const Vec3 Tj = shape.col(static_cast<Eigen::Index>(j)).head<3>();
          const Vec3 Tk = shape.col(static_cast<Eigen::Index>(k)).head<3>();
          sum += (*file.lumped)(0, i) * skew_skew(Tj, Tk);
        }
      }
      if (file.I9) sum += file.I9->middleCols<3>(3 * (kept[j] * file.modes + kept[k]));
    }
  }
  return out;
}

}  // namespace mbdae
