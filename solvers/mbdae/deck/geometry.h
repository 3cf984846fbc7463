// Vectors, matrices, orientations and the frames they are given in.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"

namespace mbdae::reading {

/// Where a datum belongs and what it may be given relative to.
struct Place {
  const Frame* node = nullptr;              ///< the datum ends up in this node's frame; null = global
  const Frame* other = nullptr;             ///< first node of a joint, for data of the second
  const Vec3* other_position = nullptr;     ///< offset of the first node [m]
  const Mat3* other_orientation = nullptr;  ///< hinge orientation of the first node
  const Frame* beside = nullptr;            ///< for a global datum: the frame that `node` and `local` mean
};

/// Three numbers or `null` [, scale, k]; no frame.
Vec3 read_vec3(Input& input, const char* what);
Vec6 read_vec6(Input& input, const char* what);
Mat3 read_mat3(Input& input, const char* what);
Mat6 read_mat6(Input& input, const char* what);
/// An orientation matrix without a frame: eye, matr, two vectors, euler angles, rotation vector.
Mat3 read_orientation(Input& input);

/// With optional `reference, <frame>,`; the result in the frame of `place`.
Vec3 read_position(Context& context, const Place& place);
Mat3 read_orientation(Context& context, const Place& place);
/// A direction: only rotations apply.
Vec3 read_direction(Context& context, const Place& place);
/// A matrix of components (inertia): rotated on both sides.
Mat3 read_matrix(Context& context, const Place& place, const char* what);
/// Velocity of a point at global position x [m/s], global components.
Vec3 read_velocity(Context& context, const Vec3& x);
Vec3 read_angular_velocity(Context& context);

/// [position,] x, [orientation,] R, [velocity,] v, [angular velocity,] w: of a reference frame or a node.
/// `description` allows `orientation description, t` in between.
Frame read_frame(Context& context, bool description);

/// `orientation description, <type>` if it is there; true if it was.
bool skip_orientation_description(Input& input);

/// exp(v x): rotation by |v| about v.
Mat3 rotation_of(const Vec3& v);
/// v x
Mat3 skew(const Vec3& v);

}  // namespace mbdae::reading
