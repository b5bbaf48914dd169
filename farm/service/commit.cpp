// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "service/commit.hpp"

#include <filesystem>
#include <string>

#include "slicecorr/farm/store.hpp"
#include "work/stages.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;

namespace {

/// Moves the log out of the attempt's folder, which will be removed; gives its new path.
std::string keep_log(const FarmFolder& folder, const Attempt& a) {
  const std::string from = folder.attempt(a.token) + "/log.txt";
  const std::string to = folder.log(a.job, a.number);
  std::error_code error;
  fs::rename(from, to, error);
  if (error) fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
  return error ? "" : to;
}

AttemptEnd end_of(const WorkOutcome& o) {
  AttemptEnd end;
  end.node = o.node;
  end.exit_code = o.exit_code;
  end.wall_s = o.wall_s;
  end.cpu_s = o.cpu_s;
  end.peak_mb = o.peak_mb;
  return end;
}

}  // namespace

detail::Settled detail::give_up_attempt(const FarmFolder& folder, Queue& queue, const Job& job,
                                        const Attempt& attempt, AttemptEnd end) {
  if (end.log.empty()) end.log = keep_log(folder, attempt);
  remove_delivery_parts(job.output_folder, job.name, job.format, attempt.token);
  const std::optional<JobState> now = queue.give_up(attempt.token, end);
  remove_attempt(folder, attempt.token);
  if (!now) return Settled::lost;
  if (*now == JobState::cancelled) return Settled::cancelled;
  return *now == JobState::queued ? Settled::put_back : Settled::failed;
}

detail::Settled detail::commit_result(const FarmFolder& folder, Queue& queue, const Job& job,
                                      const Attempt& attempt, const WorkOutcome& outcome) {
  AttemptEnd end = end_of(outcome);
  // Of a result: what was wrong with its inputs.
  end.message = outcome.message;
  if (!queue.begin_commit(attempt.token)) {
    end.reason = Reason::cancelled;
    end.message = "cancelled when it was done";
    return give_up_attempt(folder, queue, job, attempt, end);
  }
  tell_service_stage("committing");
  try {
    put_in_cache(folder, job.key, folder.attempt(attempt.token) + "/out", job.name, outcome.files);
    tell_service_stage("cached");
    ResultRecord result;
    result.figures = outcome.figures;
    result.files = outcome.files;
    result.program = outcome.program;
    result.wall_s = outcome.wall_s;
    result.delivered =
        deliver(folder, job.key, outcome.files, job.output_folder, job.name, attempt.token);
    tell_service_stage("delivered");
    end.log = keep_log(folder, attempt);
    const bool ours = queue.finish(attempt.token, result, end, false);
    tell_service_stage("finished");
    remove_attempt(folder, attempt.token);
    return ours ? Settled::done : Settled::lost;
  } catch (const DiskFull& e) {
    end.reason = Reason::disk_full;
    end.message = e.what();
  } catch (const DeviceError& e) {
    end.reason = Reason::device_failed;
    end.message = e.what();
  } catch (const InputError& e) {
    remove_from_cache(folder, job.key);
    end.reason = Reason::output_invalid;
    end.message = e.what();
  }
  return give_up_attempt(folder, queue, job, attempt, end);
}

bool finish_from_cache(const FarmFolder& folder, Queue& queue, const Claim& claim) {
  Attempt attempt;
  attempt.token = claim.token;
  attempt.job = claim.job.id;
  attempt.number = claim.number;
  AttemptEnd end;
  const auto put_back = [&](Reason reason, const std::string& message) {
    end.reason = reason;
    end.message = message;
    detail::give_up_attempt(folder, queue, claim.job, attempt, end);
    return false;
  };
  const auto begin = system_clock().steady_ms();
  if (!queue.begin_commit(claim.token)) return put_back(Reason::cancelled, "cancelled");
  auto result = queue.cached(claim.job.key);
  if (!result) return put_back(Reason::lease_lost, "its result left the cache");
  try {
    result->delivered = deliver(folder, claim.job.key, result->files, claim.job.output_folder,
                                claim.job.name, claim.token);
  } catch (const DiskFull& e) {
    return put_back(Reason::disk_full, e.what());
  } catch (const DeviceError& e) {
    return put_back(Reason::device_failed, e.what());
  } catch (const InputError& e) {
    queue.forget_result(claim.job.key, e.what());
    remove_from_cache(folder, claim.job.key);
    return put_back(Reason::lease_lost, "its result in the cache was damaged");
  }
  end.wall_s = static_cast<double>(system_clock().steady_ms() - begin) / 1000;
  return queue.finish(claim.token, *result, end, true);
}

std::int64_t serve_from_cache(const FarmFolder& folder, Queue& queue, const std::string& service,
                              const std::string& key, std::int64_t most) {
  std::int64_t done = 0;
  ClaimRequest request;
  request.service = service;
  request.cached_key = key;
  while (done < most) {
    const auto claim = queue.claim(request);
    if (!claim || !finish_from_cache(folder, queue, *claim)) break;
    ++done;
  }
  return done;
}

}  // namespace slicecorr::farm
