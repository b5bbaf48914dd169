// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The parser of toml++. Without NDEBUG what it asserts goes to TOML_ASSERT, not to the optimiser.
#undef NDEBUG
#define TOML_IMPLEMENTATION
#include "support/toml/toml_plus_plus.hpp"
