// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Containers that give their memory back.
#pragma once

namespace slicecorr::detail {

/// `container = {}` takes an empty list of elements, and keeps its memory.
template <class Container>
void release(Container& container) {
  Container().swap(container);
}

}  // namespace slicecorr::detail
