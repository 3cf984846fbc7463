// Abstract nodes, degrees of freedom, scalar functions, and what drives read of the state.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "mbdae/deck/context.h"

namespace mbdae::reading {

/// `abstract: label, algebraic | differential [, value, x0 [, derivative, xp0]];`
void read_abstract(Context& context);

enum class Order { needed, optional };

/// `label, abstract, ORDER` (no order for an algebraic node) or `label, structural, k, ORDER`, ORDER algebraic or
/// differential. Where the order is optional it only matters for what is read, and stands for `algebraic` if missing.
DofData read_dof(Context& context, Order order = Order::needed);

/// True if the dof is an algebraic abstract node, which has no rate.
bool is_algebraic(const Context& context, const DofData& dof);

/// `scalar function: "name", TYPE, ...;`
void read_scalar_function(Context& context);

/// Straight lines between points with increasing x, the outer ones going on.
ScalarFunctionPtr broken_line(std::vector<double> x, std::vector<double> y);

/// The name of a scalar function that must be there.
ScalarFunctionPtr scalar_function(Context& context);

// What the drives `node`, `element` and `dof` read, without the drive of its value.
std::shared_ptr<const Signal> read_node_signal(Context& context);
std::shared_ptr<const Signal> read_element_signal(Context& context);
std::shared_ptr<const Signal> read_dof_signal(Context& context);

}  // namespace mbdae::reading
