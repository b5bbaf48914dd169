// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_machine_room.hpp
/// A farm with one machine, which is a process of machine_peer.py, and files that it reads.
#pragma once

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <string>
#include <vector>

#include "farm_fixture.hpp"
#include "machine_peer.hpp"
#include "slicecorr/farm/machines.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

/// Waits a tenth of what people's machines are given.
inline farm::MachineTimes quick_times() {
  farm::MachineTimes t;
  t.answer_s = 3.0 * kSlowdown;
  t.stall_s = 2.0 * kSlowdown;
  t.look_s = 0.02;
  t.busy_s = 1.0 * kSlowdown;
  t.shown_s = 1.0 * kSlowdown;
  t.check_s = 3.0 * kSlowdown;
  t.settle_s = 0.6 * kSlowdown;
  t.listed_s = 1.2 * kSlowdown;
  return t;
}

/// What a test says of one kind of machine.
struct PeerKind {
  std::string peer;  ///< of machine_peer.py
  farm::MachineKind kind;
  std::string ending;  ///< of files that it reads
};
inline const std::vector<PeerKind>& peer_kinds() {
  using farm::MachineKind;
  static const std::vector<PeerKind> kinds{{"sdcp3", MachineKind::sdcp3, "goo"},
                                           {"prusalink", MachineKind::prusalink, "sl1"},
                                           {"prusalink-v1", MachineKind::prusalink, "sl1"},
                                           {"octoprint", MachineKind::octoprint, "sl1"},
                                           {"nanodlp", MachineKind::nanodlp, "nanodlp"},
                                           {"odyssey", MachineKind::odyssey, "sl1"}};
  return kinds;
}

class MachineRoomOfTest {
 public:
  explicit MachineRoomOfTest(const PeerKind& kind, const std::vector<std::string>& traps = {})
      : kind_(kind), peer(kind.peer, traps), folder(farm::open_folder(made_.path())) {
    spec.name = "m-1";
    spec.kind = kind.kind;
    spec.host = "127.0.0.1";
    spec.port = peer.port;
    if (peer.udp > 0) spec.discovery_port = peer.udp;
    if (kind.kind == farm::MachineKind::prusalink || kind.kind == farm::MachineKind::octoprint) {
      spec.key_file = made_ / "key";
      write_file(spec.key_file, std::string("abcdefgh\n"));
      ::chmod(spec.key_file.c_str(), 0600);
    }
  }
  farm::MachineRoom room(const farm::MachineTimes& times = quick_times()) const {
    return farm::MachineRoom(folder, spec, times);
  }
  /// A small stack of the machine's format.
  std::string file(unsigned seed = 1, int width = 192, int height = 108) {
    const std::string path = made_ / ("part-" + std::to_string(seed) + "." + kind_.ending);
    Images images = random_images(width, height, 5, seed);
    images.grid.pixel_x_um = images.grid.pixel_y_um = images.grid.layer_um = 50;
    StackInfo info = info_of(images.grid);
    info.exposure_s = 2;
    write_stack(path, images, info);
    return path;
  }
  std::string path(const std::string& name) const { return made_ / name; }

 private:
  FarmFolderOfTest made_;
  PeerKind kind_;

 public:
  MachinePeer peer;
  farm::FarmFolder folder;
  farm::MachineSpec spec;
};

inline constexpr farm::StartWords kBothWords{true, true};

inline farm::MachineState state_of(farm::MachineRoom& room) { return room.look().status.state; }

}  // namespace slicecorr::test
