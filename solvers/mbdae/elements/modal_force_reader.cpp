// Grammar of `force: modal`.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/elements/ends.h"
#include "mbdae/elements/modal_data.h"

namespace mbdae::reading {

ModalForceData read_modal_force(Context& context) {
  Input& input = context.input;
  const Label label = input.label("the label of a modal joint");
  context.joints.get(input, label);
  ModalForceData force;
  const std::vector<ElementData>& joints = context.deck.joints;
  const auto joint = std::find_if(joints.begin(), joints.end(),
                                  [&](const ElementData& other) { return other.id.label == label.value; });
  const auto* data = joint == joints.end() ? nullptr : joint->get_if<ModalData>();
  if (data == nullptr) input.fail(label.where, "joint " + std::to_string(label.value) + " is no modal joint");
  force.joint = static_cast<std::size_t>(joint - joints.begin());
  const int m = data->coordinates();
  std::vector<int> modes;
  if (input.more() && input.take("list")) {
    const SourcePosition where = input.where();
    const std::int64_t count = input.integer("the number of modes");
    if (count < 1 || count > m) {
      input.fail(where, "found " + std::to_string(count) + " modes, expected 1 to " + std::to_string(m));
    }
    for (std::int64_t i = 0; i < count; ++i) {
      const SourcePosition mode_where = input.where();
      const std::int64_t k = input.integer("a mode, counted among those in use");
      if (k < 1 || k > m) {
        input.fail(mode_where, "found mode " + std::to_string(k) + ", expected 1 to " + std::to_string(m));
      }
      modes.push_back(static_cast<int>(k) - 1);
    }
  } else {
    for (int k = 0; k < m; ++k) modes.push_back(k);
  }
  for (std::size_t i = 0; i < modes.size(); ++i) {
    input.need([&] {
      return "the drive of mode " + std::to_string(modes[i] + 1) + " (number " + std::to_string(i + 1) + " of " +
             std::to_string(modes.size()) + ")";
    });
    force.terms.push_back({modes[i], read_drive(context)});
  }
  if (input.more()) skip_output(input);
  return force;
}

}  // namespace mbdae::reading
