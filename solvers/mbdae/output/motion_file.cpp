// In the order of docs/io_formats/motion.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/motion_file.h"

namespace mbdae {

namespace {

constexpr std::array<int, 2> kVersion{1, 1};  // of the format; bump together with the page

}  // namespace

void write_motion_file(const std::string& path, const Motion& motion, const Integration& integration,
                       const Provenance& provenance) {
  Hdf5File file(8 * (motion.time.size() + static_cast<std::size_t>(motion.data.size())) + 65536);

  Hdf5Group& root = file.root();
  write_header(root, "pilotgen motion", kVersion, provenance);
  root.attribute("integrator", integration.integrator);
  root.attribute("rtol", integration.rtol);
  root.attribute("atol", integration.atol);
  root.dataset("time", motion.time);
  const std::array<std::uint64_t, 2> dimensions{static_cast<std::uint64_t>(motion.data.rows()),
                                                static_cast<std::uint64_t>(motion.data.cols())};
  root.dataset("data", std::span(motion.data.data(), static_cast<std::size_t>(motion.data.size())), dimensions);

  Hdf5Group channels = root.group("channels");
  channels.dataset("name", column(motion.channels, &InputInfo::name));
  channels.dataset("unit", column(motion.channels, &InputInfo::unit));

  file.save(path);
}

}  // namespace mbdae
