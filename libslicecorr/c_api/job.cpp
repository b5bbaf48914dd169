// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Jobs: threads, progress, cancellation.

#include <cstdlib>

#include "c_api/handles.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::c_api {

namespace {

/// Runs a callback of the caller, which may be C++ and throw.
template <class Call>
auto call_back(Call&& call) {
  try {
    return call();
  } catch (...) {
    throw BadCall("a callback threw an exception");
  }
}

}  // namespace

ExecutionContext job_of(slicecorr_job* handle) {
  ExecutionContext context;
  if (!handle) return context;
  context.threads = handle->threads;
  context.cancel = &handle->cancelled;
  if (handle->progress) {
    context.progress = [handle](std::string_view stage, double fraction) {
      const std::string name(stage);
      const int stop = call_back(
          [&] { return handle->progress(handle->progress_user, name.c_str(), fraction); });
      if (stop != 0) handle->cancelled = true;
    };
  }
  if (handle->notice) {
    context.notice = [handle](const std::string& text) {
      call_back([&] { handle->notice(handle->notice_user, text.c_str()); });
    };
  }
  return context;
}

std::string scratch_folder(const slicecorr_job* job, const std::string& output) {
  if (job && !job->scratch_folder.empty()) return job->scratch_folder;
  if (!output.empty()) {
    const std::size_t slash = output.rfind('/');
    return slash == std::string::npos ? "." : slash == 0 ? "/" : output.substr(0, slash);
  }
  const char* const folder = std::getenv("TMPDIR");
  return folder && *folder ? folder : "/tmp";
}

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_job* slicecorr_job_new(void) {
  slicecorr_job* made = nullptr;
  guarded(nullptr, [&] { made = new slicecorr_job; });
  return made;
}

void slicecorr_job_free(slicecorr_job* job) { delete job; }

slicecorr_status slicecorr_job_set_threads(slicecorr_job* job, int threads) {
  return guarded(error_of(job), [&] {
    need(job, "job");
    if (threads < 0 || threads > 4096) {
      throw slicecorr::InputError("threads is " + std::to_string(threads) +
                                  "; expected 0 to 4096, 0 for all cores");
    }
    job->threads = threads;
  });
}

slicecorr_status slicecorr_job_set_progress(slicecorr_job* job, slicecorr_progress progress,
                                            void* user) {
  return guarded(error_of(job), [&] {
    need(job, "job").progress = progress;
    job->progress_user = user;
  });
}

slicecorr_status slicecorr_job_set_notice(slicecorr_job* job, slicecorr_notice notice, void* user) {
  return guarded(error_of(job), [&] {
    need(job, "job").notice = notice;
    job->notice_user = user;
  });
}

slicecorr_status slicecorr_job_set_scratch_folder(slicecorr_job* job, const char* folder) {
  return guarded(error_of(job), [&] { need(job, "job").scratch_folder = folder ? folder : ""; });
}

void slicecorr_job_cancel(slicecorr_job* job) {
  static_assert(std::atomic<bool>::is_always_lock_free, "called from signal handlers");
  if (job) job->cancelled = true;
}

slicecorr_status slicecorr_job_reset(slicecorr_job* job) {
  return guarded(error_of(job), [&] { need(job, "job").cancelled = false; });
}

const char* slicecorr_job_error_text(const slicecorr_job* job) {
  return job ? job->error.c_str() : "";
}
