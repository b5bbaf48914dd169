// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Files in work, each in a program of its own: what a file does to its reader ends that alone.
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
#include "watch/done.hpp"

namespace slicecorr::post {

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

  /// What corrects one file and says what became of it, without the file's name.
  std::vector<std::string> command_;
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
