// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file maker.hpp
/// Which process made a temporary file, as its name says, and whether that process is no more. Nothing throws; all may
/// be called from any thread.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace slicecorr::detail {

/// A process on a computer since that was started: what tells it from every other, also from one of the same number
/// before or after it, in another container, or on another computer that has the same folder.
struct Maker {
  long pid = 0;
  unsigned long long started = 0;  ///< ticks since the computer's start; 0: not known
  unsigned long room = 0;  ///< the container that numbers it (its PID namespace); 0: not known
  unsigned long boot = 0;  ///< this start of the computer, eight hexadecimal digits; 0: not known
  bool operator==(const Maker&) const = default;
};

Maker this_process();

/// "PID-STARTED-ROOM-BOOT", at most 44 bytes; back from it, nothing where it is none.
std::string text_of(const Maker& maker);
std::optional<Maker> maker_of(std::string_view text);

/// Whether the process is certainly no more. A process of another computer or container never is: what it left stays,
/// unless the folder lies on a disk of this computer's own and the computer was started anew since.
bool is_gone(const Maker& maker, const std::string& folder);

}  // namespace slicecorr::detail
