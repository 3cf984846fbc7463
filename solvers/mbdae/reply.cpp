// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/reply.h"

namespace mbdae {

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
  Json& nodes = reply["nodes"] = Json::array();
  for (const NodeState& node : outcome.nodes) {
    Json orientation = Json::array();
    for (int row = 0; row < 3; ++row) orientation.push_back({node.R(row, 0), node.R(row, 1), node.R(row, 2)});
    nodes.push_back({{"name", node.name},
                     {"label", node.label},
                     {"position", {node.x(0), node.x(1), node.x(2)}},
                     {"orientation", std::move(orientation)}});
  }
  if (!outcome.dofs.empty()) {
    Json& dofs = reply["dofs"] = Json::array();
    for (const UnknownInfo& dof : outcome.dofs) {
      dofs.push_back({{"name", dof.name}, {"kind", dof.kind}, {"owner", dof.owner}, {"unit", dof.unit}});
    }
  }
  reply["output"] = outcome.output;
  return reply.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace mbdae
