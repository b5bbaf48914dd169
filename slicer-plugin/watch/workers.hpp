// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Threads that correct files.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "post/correct_file.hpp"

namespace slicecorr::post {

/// What became of a file.
struct Done {
  std::string path;
  enum class Kind { corrected, already, left_alone, not_readable, in_use, failed, cancelled } kind;
  int code = 0;         ///< exit code that the program would have had
  std::string message;  ///< what went wrong, or the remarks and figures of a correction
  double seconds = 0;
  FileIdentity made;  ///< of the corrected file
};

/// A number of files at once, in the order in which they are put in; each gets its share of the
/// threads. Signals do not reach the workers. `put` and `take` are for one thread.
class Workers {
 public:
  /// `request` must outlive this.
  Workers(int count, const PostRequest& request, const ExecutionContext& context);
  /// Waits for the files in work: `context.cancel` ends them soon.
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  void put(const std::string& path);
  std::vector<Done> take();
  /// Readable when there is something to take.
  int descriptor() const { return event_; }

 private:
  void work();
  Done correct(const std::string& path) const;

  const PostRequest& request_;
  ExecutionContext context_;
  int event_;
  std::mutex mutex_;
  std::condition_variable more_;
  bool end_ = false;
  std::deque<std::string> waiting_;
  std::vector<Done> done_;
  std::vector<std::thread> threads_;
};

}  // namespace slicecorr::post
