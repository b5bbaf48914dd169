// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Precedence for the threads that must be on time.
#pragma once

#include <string>

namespace slicecorr::bridge {

/// This thread gets real-time priority where that is allowed; its children don't. What it got, in
/// words, for the journal.
std::string raise_priority(int level);
void lower_priority();
/// Memory stays in memory, where that is allowed without limit.
std::string lock_memory();

}  // namespace slicecorr::bridge
