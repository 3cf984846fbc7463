// Cards of the elements that have a type: `joint: label, TYPE, ...;`, forces and couples.
//
// The types and their grammar are rows of the table of elements (elements/table.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/element_reader.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <string_view>
#include <utility>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/geometry.h"
#include "mbdae/drive/drive_library.h"

namespace mbdae::reading {
namespace {

constexpr const char* kOtherJoints[] = {"angular acceleration",
                                        "angular velocity",
                                        "beam slider",
                                        "brake",
                                        "deformable displacement hinge",
                                        "drive displacement",
                                        "drive displacement pin",
                                        "drive hinge",
                                        "friction",
                                        "gimbal hinge",
                                        "gimbal rotation",
                                        "imposed displacement",
                                        "imposed displacement pin",
                                        "imposed kinematics",
                                        "imposed orientation",
                                        "in line contact",
                                        "in plane contact",
                                        "inline friction",
                                        "invariant deformable displacement joint",
                                        "kinematic",
                                        "offset displacement joint",
                                        "plane displacement",
                                        "plane displacement pin",
                                        "point contact",
                                        "point surface contact",
                                        "rod bezier",
                                        "rotation",
                                        "screw",
                                        "total equation",
                                        "total reaction",
                                        "total force",
                                        "tube",
                                        "viscous body"};

constexpr const char* kOtherForces[] = {"absolute internal", "follower internal",   "total",
                                        "total internal",    "external structural", "abstract internal"};

constexpr const char* kOtherGenels[] = {"distance with offset", "rotor", "rotor trim", "swash plate"};

/// What a kind of card is called, and where its entities are kept.
struct Family {
  const char* label;
  const char* type;
  const char* unread_type;  ///< what a type that is not read here is called
  const char* kind;         ///< of identities
  Choices unread;           ///< types of the language that are not read here
  Count* count;
  Registry<std::size_t>* registry;
  std::vector<ElementData>* list;
};

Family family(Context& context, CardKind card) {
  switch (card) {
    case CardKind::joint:
      return {"a joint label", "joint type",         "joint",         "joint",
              kOtherJoints,    &context.joint_count, &context.joints, &context.deck.joints};
    case CardKind::genel:
      return {"a genel label", "genel type",         "genel",         "genel",
              kOtherGenels,    &context.genel_count, &context.genels, &context.deck.genels};
    case CardKind::force:
      return {"a force label", "force type",         "force type",    "force",
              kOtherForces,    &context.force_count, &context.forces, &context.deck.forces};
    default:
      return {"a couple label", "force type",         "force type",    "couple",
              kOtherForces,     &context.force_count, &context.forces, &context.deck.forces};
  }
}

/// The row of the type that stands there, or a message.
const ElementType& read_type(Context& context, CardKind card, const Family& family) {
  Input& input = context.input;
  const auto names = [&] {
    std::vector<const char*> out, aliases;
    for (const ElementType& row : context.elements) {
      if (row.card != card) continue;
      out.push_back(row.name);
      if (row.alias != nullptr) aliases.push_back(row.alias);
    }
    out.insert(out.end(), aliases.begin(), aliases.end());
    return out;
  };
  input.need([&] { return std::string("a ") + family.type + ": " + joined(names()); });
  for (const ElementType& row : context.elements) {
    if (row.card != card) continue;
    if (input.take(row.name) || (row.alias != nullptr && input.take(row.alias))) return row;
  }
  if (const auto words = input.peek_words()) {
    for (const char* other : family.unread) {
      if (words->is(other)) {
        input.fail(words->where, std::string("not supported: the ") + family.unread_type + " `" + other + "`");
      }
    }
  }
  input.keyword(names(), family.type);  // fails with the choices
  throw Reported{};
}

}  // namespace

void skip_joint_options(Input& input) {
  while (input.more()) {
    if (skip_orientation_description(input) || skip_output(input)) continue;
    if (!input.take("inverse dynamics")) return;
    for (const char* flag : {"torque", "prescribed motion", "right hand side", "ergonomy"}) {
      if (input.more() && input.take(flag)) input.yes_no();
    }
  }
}

namespace {

/// What follows `joint:`, but for the card's end. Returns the new element.
ElementData& read_element_arguments(Context& context, CardKind card) {
  Input& input = context.input;
  const Family known = family(context, card);
  ++known.count->found;
  const Label label = input.label(known.label);
  known.registry->announce(input, label);
  skip_name(input);
  const SourcePosition where = input.where();
  const ElementType& type = read_type(context, card, known);
  ElementData element{identity(label, known.kind), &type, type.read(context, where)};
  if (card == CardKind::joint) {
    skip_joint_options(input);
    if (input.more()) {
      if (const auto words = input.peek_words(); words && words->is("initial state")) {
        input.fail(
            words->where,
            std::string("`initial state` belongs at the end of clamp, revolute hinge and revolute pin only, not of `") +
                type.name + "`");
      }
    }
  }
  if (card == CardKind::genel && input.more()) skip_output(input);
  if (input.more()) input.end_card();  // tells what does not belong there
  known.list->push_back(std::move(element));
  known.registry->define(label, known.list->size() - 1);
  return known.list->back();
}

constexpr const char* kDriven[] = {"joint", "genel", "force", "couple"};
constexpr CardKind kDrivenKinds[] = {CardKind::joint, CardKind::genel, CardKind::force, CardKind::couple};

/// The element that already is there.
ElementData& existing_element(Context& context) {
  Input& input = context.input;
  const Family known = family(context, kDrivenKinds[input.keyword(kDriven, "card of an element")]);
  return (*known.list)[known.registry->get(input, input.label(known.label))];
}

}  // namespace

void read_element(Context& context, CardKind card) {
  read_element_arguments(context, card);
  context.input.end_card();
}

void read_driven(Context& context) {
  static constexpr const char* kExisting[] = {"existing"};
  Input& input = context.input;
  const Label label = input.label("the label of the driven element");
  const std::size_t drives = context.deck.pieced_drives.size();
  const DrivePtr drive = read_drive(context);
  context.deck.pieced_drives.resize(drives);  // what counts is only where it is zero
  input.need([&] { return "the driven element: " + joined(kDriven) + ", each with `:`, or `existing:`"; });
  const SourcePosition where = input.where();
  const bool existing = input.take_card(kExisting) == 0;
  const int card = existing ? -1 : input.take_card(kDriven);
  if (!existing && card < 0) {
    const auto words = input.peek_words();
    const auto is_word = [&](const char* name) { return words->is(name); };
    if (words && (is_word("existing") || std::any_of(std::begin(kDriven), std::end(kDriven), is_word))) {
      input.fail(where, "found " + quoted(words->written) + " without a colon, expected `" + words->written + ": ...`");
    }
    input.fail(where, (words ? "not supported: a driven " + quoted(words->written) : "found something else") +
                          ", expected " + joined(kDriven) + ", each with `:`, or `existing:`");
  }
  ElementData& element = existing ? existing_element(context) : read_element_arguments(context, kDrivenKinds[card]);
  if (element.id.label != label.value) {
    input.fail(where, "the driven element has the label " + std::to_string(element.id.label) + ", expected " +
                          std::to_string(label.value) + ", that of this card");
  }
  if (element.driver) input.fail(where, "the element is driven already");
  const ElementType& type = *element.type;
  const bool owns = (type.scalars != nullptr && type.scalars(element.data) > 0) || type.coordinates != nullptr;
  const bool muscle = type.counts != nullptr && std::string_view(type.counts(element.data)) == "muscles";
  if (owns || muscle) {
    input.fail(where, std::string("not supported: a driven ") + (muscle ? "muscle" : type.name) +
                          (muscle ? "" : ", which has unknowns of its own"));
  }
  element.driver = drive;
  context.deck.pieced_drives.push_back(std::make_shared<const GateDrive>(drive));
  input.end_card();
}

}  // namespace mbdae::reading
