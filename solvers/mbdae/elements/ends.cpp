// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/ends.h"

namespace mbdae::reading {

Place End::place() const {
  Place place;
  place.node = &frame;
  return place;
}

Place End::after(const End& first) const {
  Place place = this->place();
  place.other = &first.frame;
  place.other_position = &first.position;
  place.other_orientation = &first.orientation;
  return place;
}

End read_end(Context& context) {
  End end;
  end.node = context.node();
  end.frame = context.frame(end.node);
  return end;
}

/// `position, x`
void read_offset(Context& context, const Place& place, Presence presence, Vec3* out, const char* word) {
  Input& input = context.input;
  const bool named = input.more() && input.take(word);
  if (!named && presence == Presence::optional) return;
  *out = read_position(context, place);  // the word may be left out
}

/// [orientation, R]
void read_hinge(Context& context, const Place& place, Mat3* out, const char* word) {
  Input& input = context.input;
  if (!input.more()) return;
  // `hinge` is the old word.
  const bool old = std::string_view(word) == "orientation" && input.take("hinge");
  if (old || input.take(word)) *out = read_orientation(context, place);
}

/// Two nodes, each with a position and an orientation: the common form of most joints.
std::pair<End, End> read_two_ends(Context& context, Presence position) {
  End first = read_end(context);
  read_offset(context, first.place(), position, &first.position);
  read_hinge(context, first.place(), &first.orientation);
  End second = read_end(context);
  read_offset(context, second.after(first), position, &second.position);
  read_hinge(context, second.after(first), &second.orientation);
  return {first, second};
}

bool at_vector(Input& input) {
  if (!input.more()) return false;
  if (input.at_real()) return true;
  const auto words = input.peek_words();
  return words && (words->is("null") || words->is("reference"));
}

std::pair<End, End> read_two_plain_ends(Context& context) {
  const auto presence = [&] { return at_vector(context.input) ? Presence::required : Presence::optional; };
  End first = read_end(context);
  read_offset(context, first.place(), presence(), &first.position);
  read_hinge(context, first.place(), &first.orientation);
  End second = read_end(context);
  read_offset(context, second.after(first), presence(), &second.position);
  read_hinge(context, second.after(first), &second.orientation);
  return {first, second};
}

Pin read_pin(Context& context) {
  Pin pin;
  pin.end = read_end(context);
  read_offset(context, pin.end.place(), Presence::required, &pin.end.position);
  read_hinge(context, pin.end.place(), &pin.end.orientation);
  read_offset(context, {}, Presence::required, &pin.X0);
  read_hinge(context, {}, &pin.R0);
  return pin;
}

}  // namespace mbdae::reading
