// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file record.hpp
/// DIR/machines/NAME.json: what is remembered of a machine, and who may act on it.
#pragma once

#include <string>

#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm::detail {

/// Reads a record; an empty one where there is none. Throws `DeviceError` where one is there that can't
/// be read: what is not known must not count as an empty plate.
MachineRecord read_record(const std::string& path);
/// On the disk when it returns. Throws `DeviceError`.
void write_record(const std::string& path, const MachineRecord& record);

/// What a look at the machine says of the print that is remembered. `ended`: asks the machine how a
/// print of this task ended.
void follow(MachineRecord& record, const MachineStatus& status, std::int64_t wall_ms,
            const std::function<std::optional<PrintEnd>(const std::string& task)>& ended);

/// Whether two names are of one file: machines put folders before names.
bool same_file(const std::string& a, const std::string& b);

/// The right to act on a machine: one process at a time has it.
class ActLock {
 public:
  explicit ActLock(const std::string& path);
  ~ActLock();
  ActLock(const ActLock&) = delete;
  ActLock& operator=(const ActLock&) = delete;
  bool held() const { return held_; }

 private:
  int file_ = -1;
  bool held_ = false;
};

}  // namespace slicecorr::farm::detail
