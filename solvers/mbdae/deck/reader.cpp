// The whole deck: blocks in their order, cards to their readers, recovery after errors.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/reader.h"

#include <algorithm>
#include <exception>
#include <new>
#include <utility>

#include "mbdae/deck/block_reader.h"
#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/file_driver_reader.h"
#include "mbdae/deck/law_reader.h"
#include "mbdae/deck/scalar_reader.h"
#include "mbdae/deck/source.h"

namespace mbdae {
namespace reading {
namespace {

/// The blocks in their mandatory order.
constexpr const char* kBlocks[] = {"data", "initial value", "control data", "nodes", "elements", "drivers"};
constexpr int kBlockCount = 5;  ///< those that must be there; `drivers` may stand before the elements
/// The blocks in the order of `kBlocks`, then other names of theirs.
constexpr const char* kBlockNames[] = {"data",     "initial value", "control data", "nodes",
                                       "elements", "drivers",       "multistep"};
enum Block { kData, kInitialValue, kControlData, kNodes, kElements, kDrivers };

constexpr const char* kElementCards[] = {"body", "joint", "genel", "gravity", "force", "couple", "driven"};
constexpr const char* kOtherElements[] = {"aerodynamic beam",
                                          "aerodynamic beam2",
                                          "aerodynamic beam3",
                                          "aerodynamic body",
                                          "aeromodal",
                                          "air properties",
                                          "automatic structural",
                                          "beam",
                                          "beam2",
                                          "beam3",
                                          "bind",
                                          "bulk",
                                          "electric",
                                          "generic aerodynamic force",
                                          "hydraulic",
                                          "induced velocity",
                                          "inertia",
                                          "joint regularization",
                                          "loadable",
                                          "membrane4eas",
                                          "modal",
                                          "plate",
                                          "rotor",
                                          "shell4eas",
                                          "shell4easans",
                                          "solid",
                                          "surface load",
                                          "thermal",
                                          "user defined",
                                          "variable body"};
constexpr const char* kDriverCards[] = {"file"};
constexpr const char* kOtherNodes[] = {"electric", "hydraulic", "parameter", "thermal", "output"};
constexpr const char* kEverywhere[] = {
    "set",         "include", "remark", "reference", "drive caller", "constitutive law", "scalar function",
    "module load", "begin",   "end",    "chdir",     "setenv"};
constexpr const char* kOtherGlobals[] = {
    "template drive caller", "hydraulic fluid", "c81 data", "friction", "license", "namespace", "plugin"};

class Reader {
 public:
  Reader(Diagnostics& diagnostics, ElementTable elements) : context_(diagnostics, elements) {}

  void read(std::string text, const std::string& name) {
    context_.input.open(std::move(text), name);
    while (!diagnostics().full()) {
      try {
        const Words* const card = context_.input.next_card();
        if (card == nullptr) break;
        read_card(*card);
      } catch (const Reported&) {
        if (!diagnostics().has_errors()) {  // a card that vanished without a word would be worse than a poor word
          diagnostics().error(context_.input.card_position(), "this card cannot be read");
        }
        context_.input.skip_card();
      }
    }
    if (!diagnostics().full()) check_end();
  }

  Deck take() { return std::move(context_.deck); }

 private:
  Diagnostics& diagnostics() { return context_.input.diagnostics(); }

  void read_card(const Words& card) {
    Input& input = context_.input;
    if (card.is("begin")) {
      begin_block();
    } else if (card.is("end")) {
      end_block(card);
    } else if (card.is("set")) {
      input.set();
    } else if (card.is("include")) {
      input.include();
    } else if (card.is("chdir")) {
      input.change_directory();
    } else if (card.is("setenv")) {
      read_environment();
    } else if (card.is("remark") || card.is("print symbol table")) {
      input.ignore_arguments();
      input.end_card();
    } else if (!read_common(card)) {
      read_block_card(card);
    }
  }

  /// `setenv: [overwrite, yes | no,] "NAME=VALUE";` matters to MBDyn's own process only.
  void read_environment() {
    Input& input = context_.input;
    if (input.take("overwrite")) input.yes_no();
    const SourcePosition where = input.where();
    const std::string text = input.string("\"NAME=VALUE\"");
    if (text.empty() || text.front() == '=') input.fail(where, "found " + quoted(text) + ", expected \"NAME=VALUE\"");
    input.end_card();
  }

  /// Cards that are legal in and between blocks from the control data onward.
  bool read_common(const Words& card) {
    Input& input = context_.input;
    const bool reference = card.is("reference"), drive = card.is("drive caller"), law = card.is("constitutive law");
    const bool module = card.is("module load"), function = card.is("scalar function");
    if (!reference && !drive && !law && !module && !function) return false;
    if (drive && done_ <= kControlData && block_ != kControlData) {
      input.fail(card.where,
                 "the card " + quoted(card.written) + " comes too early, expected after `begin: control data;`");
    }
    if (reference) {
      read_reference(context_);
    } else if (drive) {
      read_drive_caller(context_);
    } else if (law) {
      read_constitutive_law(context_);
    } else if (function) {
      read_scalar_function(context_);
    } else {
      const std::string name = input.string("a module name in quotes");
      input.ignore_arguments();
      input.end_card();
      if (name.find("muscles") != std::string::npos) context_.muscle_module_loaded = true;
    }
    return true;
  }

  void read_block_card(const Words& card) {
    switch (block_) {
      case kData:
        return read_data_card(context_, card);
      case kInitialValue:
        return read_initial_value_card(context_, card);
      case kControlData:
        return read_control_data_card(context_, card);
      case kNodes:
        return read_node_card(card);
      case kElements:
        return read_element_card(card);
      case kDrivers:
        if (card.is("file")) return read_file_driver(context_);
        unknown(card, "expected `file: ...;` or `end: drivers;`", kDriverCards);
      default:
        unknown(card,
                done_ < kBlockCount ? std::string("expected `begin: ") + kBlocks[done_] + ";`" : "the deck is complete",
                kEverywhere);
    }
  }

  void read_node_card(const Words& card) {
    static constexpr const char* kCards[] = {"structural", "abstract"};
    if (card.is("structural")) return read_structural(context_);
    if (card.is("abstract")) return read_abstract(context_);
    for (const char* other : kOtherNodes) {
      if (card.is(other)) context_.input.fail(card.where, std::string("not supported: the node `") + other + "`");
    }
    unknown(card, "expected `structural: ...;`, `abstract: ...;` or `end: nodes;`", kCards);
  }

  void read_element_card(const Words& card) {
    if (card.is("body")) return read_body(context_);
    if (card.is("joint")) return read_element(context_, CardKind::joint);
    if (card.is("genel")) return read_element(context_, CardKind::genel);
    if (card.is("gravity")) return read_gravity(context_);
    if (card.is("force")) return read_element(context_, CardKind::force);
    if (card.is("couple")) return read_element(context_, CardKind::couple);
    if (card.is("driven")) return read_driven(context_);
    for (const char* other : kOtherElements) {
      if (card.is(other)) context_.input.fail(card.where, std::string("not supported: the element `") + other + "`");
    }
    unknown(card, "expected " + joined(kElementCards) + " or `end: elements;`", kElementCards);
  }

  [[noreturn]] void unknown(const Words& card, const std::string& expected, Choices near) {
    for (const char* other : kOtherGlobals) {
      if (card.is(other)) context_.input.fail(card.where, std::string("not supported: the card `") + other + "`");
    }
    std::string hint = suggestion(card.text, near);
    if (hint.empty()) hint = suggestion(card.text, kEverywhere);
    const char* const what = hint.empty() ? "not supported: the card " : "unknown card ";
    context_.input.fail(card.where, what + quoted(card.written) + ", " + expected + hint);
  }

  void begin_block() {
    Input& input = context_.input;
    const SourcePosition where = input.where();
    input.need([&] { return "the name of a block: " + joined(kBlocks); });
    const auto words = input.peek_words();
    if (words && words->is("inverse dynamics")) input.fail(where, "not supported: the block `inverse dynamics`");
    for (const char* other : {"output", "parallel"}) {
      if (words && words->is(other)) input.fail(where, std::string("not supported: the block `") + other + "`");
    }
    const int block = block_name();
    input.end_card();
    if (block_ >= 0) {
      diagnostics().error(where, std::string("found the beginning of `") + kBlocks[block] + "` inside `" +
                                     kBlocks[block_] + "`, expected `end: " + kBlocks[block_] + ";` (line " +
                                     std::to_string(begin_.line) + " begins it)");
      if (block_ != kDrivers) done_ = block_ + 1;
    }
    if (block == kDrivers ? done_ != kElements || drivers_read_ : block != done_) {
      const std::string expected =
          done_ < kBlockCount ? std::string("`begin: ") + kBlocks[done_] + ";`" : "the end of the deck";
      diagnostics().error(where, std::string("found the block `") + kBlocks[block] + "`, expected " + expected);
    }
    block_ = block;
    begin_ = where;
    drivers_read_ |= block == kDrivers;
    if (block == kControlData && context_.initial_time() == 0.0) input.start_clock();
  }

  int block_name() {
    const int block = context_.input.keyword(kBlockNames, "block");
    return block <= kDrivers ? block : kInitialValue;
  }

  void end_block(const Words& card) {
    Input& input = context_.input;
    const SourcePosition where = input.where();
    const int block = block_name();
    input.end_card();
    if (block_ < 0)
      input.fail(card.where, std::string("found the end of `") + kBlocks[block] + "`, which has not begun");
    if (block != block_) {
      diagnostics().error(
          where, std::string("found the end of `") + kBlocks[block] + "`, expected `end: " + kBlocks[block_] + ";`");
    }
    if (block_ == kInitialValue) check_initial_value(context_, begin_);
    if (block_ == kDrivers && context_.driver_count.found == 0) {
      diagnostics().error(begin_, "the block `drivers` is empty, expected `file: ...;` in it, or no such block");
    }
    if (block_ != kDrivers) done_ = std::max(done_, block_ + 1);
    block_ = -1;
  }

  void check_end() {
    const SourcePosition end = context_.input.where();
    if (block_ >= 0) {
      diagnostics().error(end, std::string("the file ends inside the block `") + kBlocks[block_] + "` (begun at line " +
                                   std::to_string(begin_.line) + "), expected `end: " + kBlocks[block_] + ";`");
    } else if (done_ < kBlockCount) {
      diagnostics().error(end, std::string("the file ends here, expected `begin: ") + kBlocks[done_] + ";`");
    } else {
      check_counts(context_);
    }
  }

  Context context_;
  int block_ = -1;  // open block
  int done_ = 0;    // blocks before this one are complete
  bool drivers_read_ = false;
  SourcePosition begin_;
};

ReadResult finish(Diagnostics& diagnostics, Reader* reader) {
  ReadResult result;
  if (reader != nullptr && !diagnostics.has_errors()) {
    result.deck = reader->take();
    result.deck->files = diagnostics.files();
  }
  result.diagnostics = diagnostics.take();
  return result;
}

ReadResult read(std::string text, const std::string& name, ElementTable elements) {
  Diagnostics diagnostics;
  diagnostics.add_file(name);
  try {
    std::string problem;
    if (!check_text(text, &problem)) {
      diagnostics.error({0, 0, 0}, problem);
      return finish(diagnostics, nullptr);
    }
    Reader reader(diagnostics, elements);
    reader.read(std::move(text), name);
    return finish(diagnostics, &reader);
  } catch (const std::bad_alloc&) {
    diagnostics.error({0, 0, 0}, "the deck needs more memory than there is");
  } catch (const std::exception& error) {
    diagnostics.error({0, 0, 0}, std::string("the deck cannot be read: ") + error.what());
  }
  return finish(diagnostics, nullptr);
}

}  // namespace
}  // namespace reading

ReadResult read_deck_text(const std::string& text, const std::string& name, ElementTable elements) {
  return reading::read(text, name, elements);
}

ReadResult read_deck_file(const std::string& path, ElementTable elements) {
  std::string text, problem;
  if (reading::load_text(path, &text, &problem)) return reading::read(std::move(text), path, elements);
  reading::Diagnostics diagnostics;
  diagnostics.add_file(path);
  diagnostics.error({0, 0, 0}, problem);
  return reading::finish(diagnostics, nullptr);
}

}  // namespace mbdae
