// An outcome as JSON: the reply of docs/io_formats/serve.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "mbdae/job.h"

namespace mbdae {

using Json = nlohmann::ordered_json;

/// The reply to the request `id`; one line without its end. Bytes that are not UTF-8 become U+FFFD.
std::string reply_line(const Json& id, const Outcome& outcome);

}  // namespace mbdae
