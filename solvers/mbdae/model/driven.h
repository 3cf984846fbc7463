// Driven elements: there while a drive is not zero, gone otherwise.
//
// While it is gone, an element adds nothing, and the reactions that it owns are zero by equations of their own:
//
//   g[lambda] += lambda
//
// In the form for accelerations and variable steps their rows are empty, which makes them redundant constraints.
// Source: MBDyn's driven elements. Tangent: that of the element; test "driven elements" (test_model_driven.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "mbdae/model/element.h"

namespace mbdae {

/// The element itself without a drive.
std::unique_ptr<Element> driven(std::unique_ptr<Element> element, const DrivePtr& drive);

}  // namespace mbdae
