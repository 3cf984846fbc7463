// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/reply.h"

#include <array>
#include <charconv>
#include <cmath>

namespace mbdae {

namespace {

std::string dump(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

/// As short as reading it back allows, and never an integer: `1.0`, as everywhere in the reply.
void append_number(double value, std::string* text) {
  if (!std::isfinite(value)) {
    *text += "null";
    return;
  }
  std::array<char, 32> buffer;
  const char* const end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  const std::string_view digits(buffer.data(), static_cast<std::size_t>(end - buffer.data()));
  *text += digits;
  if (digits.find_first_of(".e") == std::string_view::npos) *text += ".0";
}

void append_vector(const Eigen::Ref<const Eigen::RowVector3d>& vector, std::string* text) {
  for (int i = 0; i < 3; ++i) {
    *text += i == 0 ? '[' : ',';
    append_number(vector(i), text);
  }
  *text += ']';
}

/// The list of poses. They are most of a reply: a tree of values for them would cost more than reading a short deck.
void append_poses(const std::vector<NodeState>& nodes, std::string* text) {
  *text += '[';
  for (const NodeState& node : nodes) {
    if (&node != nodes.data()) *text += ',';
    *text += "{\"name\":" + dump(node.name) + ",\"label\":" + std::to_string(node.label) + ",\"position\":";
    append_vector(node.x.transpose(), text);
    for (int row = 0; row < 3; ++row) {
      *text += row == 0 ? ",\"orientation\":[" : ",";
      append_vector(node.R.row(row), text);
    }
    *text += "]}";
  }
  *text += ']';
}

}  // namespace

std::string reply_line(const Json& id, const Outcome& outcome) {
  Json reply;
  reply["id"] = id;
  reply["status"] = status_name(outcome.status);
  reply["exit_code"] = exit_code(outcome.status);
  reply["message"] = outcome.message;
  Json& diagnostics = reply["diagnostics"] = Json::array();
  for (const Diagnostic& diagnostic : outcome.diagnostics) {
    diagnostics.push_back({{"file", diagnostic.file},
                           {"line", diagnostic.line},
                           {"column", diagnostic.column},
                           {"severity", diagnostic.severity == Severity::error ? "error" : "warning"},
                           {"message", diagnostic.message}});
  }
  reply["analysis"] = outcome.analysis;
  reply["iterations"] = outcome.iterations;
  reply["residual_norm"] = outcome.residual_norm;
  reply["seconds"] = outcome.seconds;
  Json& counts = reply["counts"] = Json::object();
  for (const auto& [name, count] : outcome.counts) counts[name] = count;
  Json rest;  // after the poses
  if (!outcome.dofs.empty()) {
    Json& dofs = rest["dofs"] = Json::array();
    for (const UnknownInfo& dof : outcome.dofs) {
      dofs.push_back({{"name", dof.name}, {"kind", dof.kind}, {"owner", dof.owner}, {"unit", dof.unit}});
    }
  }
  Json& datasets = rest["datasets"] = Json::object();
  for (const DatasetPlace& place : outcome.datasets) {
    Json& numbers = datasets[place.name] = {place.offset};
    for (const std::uint64_t size : place.dimensions) numbers.push_back(size);
  }
  rest["output"] = outcome.output;
  if (!outcome.more_outputs.empty()) rest["more_outputs"] = outcome.more_outputs;

  std::string line = dump(reply);
  line.pop_back();  // }
  line += ",\"nodes\":";
  append_poses(outcome.nodes, &line);
  return line.append(",").append(dump(rest), 1);  // without {
}

}  // namespace mbdae
