// Grammar that most elements share: a node with a position and an orientation on it, two of them, pins.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>

#include "mbdae/deck/context.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/geometry.h"

namespace mbdae::reading {

/// A node of a joint with its frame, so that places can point at it.
struct End {
  NodeIndex node = 0;
  Frame frame;
  Vec3 position = Vec3::Zero();
  Mat3 orientation = Mat3::Identity();

  Place place() const;
  /// Place of a datum of this node given after the first node's.
  Place after(const End& first) const;
};

End read_end(Context& context);

enum class Presence { required, optional };

/// `[position,] x`; an optional one needs the word.
void read_offset(Context& context, const Place& place, Presence presence, Vec3* out, const char* word = "position");

/// True if the argument can only be the beginning of a position: `null`, a frame, a real number.
bool at_vector(Input& input);

/// [orientation, R], also `hinge, R`
void read_hinge(Context& context, const Place& place, Mat3* out, const char* word = "orientation");

/// Two nodes, each with a position and an orientation: the common form of most joints.
std::pair<End, End> read_two_ends(Context& context, Presence position);

/// The same where nothing else begins like a position, so that the word may be left out.
std::pair<End, End> read_two_plain_ends(Context& context);

/// A node's point and axes, and where they are pinned in space.
struct Pin {
  End end;
  Vec3 X0 = Vec3::Zero();
  Mat3 R0 = Mat3::Identity();
};

Pin read_pin(Context& context);

/// [initial state, F1, ...] with N components, the others zero.
template <int N>
std::optional<Vec6> read_initial_state(Context& context) {
  Input& input = context.input;
  if (!input.more() || !input.take("initial state")) return std::nullopt;
  Vec6 state = Vec6::Zero();
  for (int i = 0; i < N; ++i) state(i) = input.real("a component of the initial reaction");
  return state;
}

}  // namespace mbdae::reading
