// In the order of docs/io_formats/motion.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/motion_file.h"

namespace mbdae {

namespace {

constexpr std::array<int, 2> kVersion{1, 0};  // of the format; bump together with the page

}  // namespace

void write_motion_file(const std::string& path, const Motion& motion, const Integration& integration,
                       const Provenance& provenance) {
  Hdf5File file(8 * (motion.time.size() + static_cast<std::size_t>(motion.data.size())) + 65536);

  Hdf5Group& root = file.root();
  root.attribute("filetype", "pilotgen motion");
  root.attribute("version", kVersion);
  root.attribute("solver", provenance.solver);
  root.attribute("deck_sha256", provenance.deck_sha256);
  root.attribute("integrator", integration.integrator);
  root.attribute("rtol", integration.rtol);
  root.attribute("atol", integration.atol);
  root.dataset("time", motion.time);
  const std::array<std::uint64_t, 2> dimensions{static_cast<std::uint64_t>(motion.data.rows()),
                                                static_cast<std::uint64_t>(motion.data.cols())};
  root.dataset("data", std::span(motion.data.data(), static_cast<std::size_t>(motion.data.size())), dimensions);

  std::vector<std::string> names, units;
  for (const InputInfo& channel : motion.channels) {
    names.push_back(channel.name);
    units.push_back(channel.unit);
  }
  Hdf5Group channels = root.group("channels");
  channels.dataset("name", names);
  channels.dataset("unit", units);

  file.save(path);
}

}  // namespace mbdae
