// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/process/failure.hpp"

#include <filesystem>
#include <new>
#include <system_error>

#include "slicecorr/error.hpp"

namespace slicecorr {

Failure failure_at_hand() {
  using enum Failure::Kind;
  try {
    throw;
  } catch (const Cancelled& e) {
    return {cancelled, e.what()};
  } catch (const InputError& e) {
    return {input, e.what()};
  } catch (const InfeasibleError& e) {
    return {infeasible, e.what()};
  } catch (const DeviceError& e) {
    return {device, e.what()};
  } catch (const std::bad_alloc&) {
    return {memory, "out of memory"};
  } catch (const std::filesystem::filesystem_error& e) {
    return {disk, e.what()};
  } catch (const std::system_error& e) {
    return {system, std::string("the system refuses what is needed: ") + e.what()};
  } catch (const std::exception& e) {
    return {defect, std::string("a defect of the program: ") + e.what()};
  } catch (...) {
    return {defect, "a defect of the program: something of an unknown type was thrown"};
  }
}

}  // namespace slicecorr
