// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "c_api/guard.hpp"

#include <filesystem>
#include <new>

#include "slicecorr/error.hpp"
#include "slicecorr/version.hpp"
#include "support/process/failure.hpp"

namespace slicecorr::c_api {

namespace {

void set_text(std::string* place, const char* text) noexcept {
  if (!place) return;
  try {
    *place = text;
  } catch (...) {
    place->clear();
  }
}

slicecorr_status tell(slicecorr_status status, const char* text, std::string* own) noexcept {
  set_text(&thread_error(), text);
  set_text(own, text);
  return status;
}

}  // namespace

std::string& thread_error() noexcept {
  thread_local std::string text;
  return text;
}

slicecorr_status succeeded(std::string* own) noexcept {
  thread_error().clear();
  if (own) own->clear();
  return SLICECORR_OK;
}

static slicecorr_status status_of(Failure::Kind kind) {
  switch (kind) {
    case Failure::Kind::cancelled:
      return SLICECORR_CANCELLED;
    case Failure::Kind::input:
      return SLICECORR_BAD_INPUT;
    case Failure::Kind::infeasible:
      return SLICECORR_INFEASIBLE;
    case Failure::Kind::defect:
      return SLICECORR_DEFECT;
    default:
      return SLICECORR_DEVICE;
  }
}

slicecorr_status failed(std::string* own) noexcept {
  try {
    throw;
  } catch (const Missed& e) {
    return tell(SLICECORR_MISSED, e.what(), own);
  } catch (const BadCall& e) {
    return tell(SLICECORR_BAD_CALL, e.what(), own);
  } catch (const UnknownName& e) {
    return tell(SLICECORR_UNKNOWN_NAME, e.what(), own);
  } catch (...) {
    try {
      const Failure failure = failure_at_hand();
      return tell(status_of(failure.kind), failure.text.c_str(), own);
    } catch (...) {  // no memory for the text
      return tell(SLICECORR_DEVICE, "out of memory", own);
    }
  }
}

void check_struct_size(std::size_t size, std::size_t first_version, const char* type) {
  // No version will be as large as this: the caller forgot to set it.
  constexpr std::size_t absurd = 4096;
  if (size >= first_version && size <= absurd) return;
  throw BadCall(std::string(type) + ".struct_size is " + std::to_string(size) +
                "; expected sizeof(" + type + "), at least " + std::to_string(first_version));
}

}  // namespace slicecorr::c_api

const char* slicecorr_version(void) { return slicecorr::version; }

int slicecorr_abi_version(void) { return SLICECORR_ABI_VERSION; }

const char* slicecorr_status_text(slicecorr_status status) {
  switch (status) {
    case SLICECORR_OK:
      return "done";
    case SLICECORR_DEFECT:
      return "a defect of the library";
    case SLICECORR_BAD_INPUT:
      return "an input that can't be read or does not fit";
    case SLICECORR_INFEASIBLE:
      return "physically infeasible";
    case SLICECORR_DEVICE:
      return "disk or device failed";
    case SLICECORR_MISSED:
      return "a limit was missed";
    case SLICECORR_CANCELLED:
      return "cancelled";
    case SLICECORR_BAD_CALL:
      return "a wrong call";
    case SLICECORR_UNKNOWN_NAME:
      return "a name that this version does not know";
    default:
      return "no status of this version";
  }
}

const char* slicecorr_error_text(void) { return slicecorr::c_api::thread_error().c_str(); }
