// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Scans of prints in the record.

#include <fmt/format.h>

#include "record/database.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"

namespace slicecorr::farm {

using detail::Rows;
using detail::Transaction;

int Queue::add_scan(const KeptScan& s) {
  Transaction transaction(*db_);
  int number = 1;
  {
    Rows r = db_->query(
        "SELECT coalesce(max(number), 0), coalesce(sum(NOT removed), 0) FROM scans WHERE job = ?1",
        s.job);
    if (r.next()) {
      number += static_cast<int>(r.integer(0));
      if (r.integer(1) >= kMostScansOfJob) {
        throw InputError(fmt::format("job {} has {} scans, and may have no more; remove some",
                                     s.job, kMostScansOfJob));
      }
    }
  }
  db_->run(
      "INSERT INTO scans(job, number, folder, file, bytes, user, at_ms, unit, voxel_um, points, "
      "with_design, mean_um, mean_abs_um, p95_um, worst_um, unseen_share) "
      "VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16)",
      s.job, number, s.folder, s.file, s.bytes, s.user, clock_->wall_ms(), s.unit, s.voxel_um,
      s.points, s.with_design, s.mean_um, s.mean_abs_um, s.p95_um, s.worst_um, s.unseen_share);
  event("scan_kept", fmt::format("scan {}, {}: {}", number, s.file, in_words(s)), s.job);
  transaction.commit();
  return number;
}

bool Queue::remove_scan(JobId job, int number, const std::string& by) {
  Transaction transaction(*db_);
  if (db_->run("UPDATE scans SET removed = 1 WHERE job = ?1 AND number = ?2 AND NOT removed", job,
               number) == 0) {
    return false;
  }
  event("scan_removed", fmt::format("scan {}, by {}", number, by), job);
  transaction.commit();
  return true;
}

void Queue::record_next(const NextPrint& n) {
  Transaction transaction(*db_);
  db_->run("INSERT INTO scan_nexts VALUES(?1, ?2, ?3, ?4, ?5)", n.job, n.of, n.before_mean_um,
           n.before_p95_um, n.words);
  transaction.commit();
}

bool Queue::knows_scan(const std::string& folder) {
  Rows r = db_->query("SELECT 1 FROM scans WHERE folder = ?1 AND NOT removed", folder);
  return r.next();
}

std::vector<KeptScan> ReadModel::scans(JobId job) {
  std::vector<KeptScan> list;
  const std::string select =
      "SELECT s.job, s.number, s.folder, s.file, s.bytes, s.user, s.at_ms, s.unit, s.voxel_um, "
      "s.points, s.with_design, s.mean_um, s.mean_abs_um, s.p95_um, s.worst_um, s.unseen_share, "
      "j.name, w.printer, w.resin FROM scans s JOIN jobs j ON j.id = s.job "
      "JOIN works w ON w.key = j.key WHERE NOT s.removed ";
  Rows r = job == 0 ? db_->query(select + "ORDER BY s.id")
                    : db_->query(select + "AND s.job = ?1 ORDER BY s.id", job);
  while (r.next()) {
    KeptScan s;
    s.job = r.integer(0);
    s.number = static_cast<int>(r.integer(1));
    s.folder = r.text(2);
    s.file = r.text(3);
    s.bytes = r.integer(4);
    s.user = r.text(5);
    s.at_ms = r.integer(6);
    s.unit = r.text(7);
    s.voxel_um = r.number(8);
    s.points = r.integer(9);
    s.with_design = r.integer(10) != 0;
    s.mean_um = r.number(11);
    s.mean_abs_um = r.number(12);
    s.p95_um = r.number(13);
    s.worst_um = r.number(14);
    s.unseen_share = r.number(15);
    s.name = r.text(16);
    s.printer = r.text(17);
    s.resin = r.text(18);
    list.push_back(std::move(s));
  }
  return list;
}

std::optional<NextPrint> ReadModel::next_of(JobId job) {
  Rows r = db_->query(
      "SELECT of_job, before_mean_um, before_p95_um, words FROM scan_nexts WHERE job = ?1", job);
  if (!r.next()) return std::nullopt;
  return NextPrint{job, r.integer(0), r.number(1), r.number(2), r.text(3)};
}

std::pair<std::string, std::string> ReadModel::work_of(JobId job) {
  Rows r = db_->query(
      "SELECT w.spec, s.json FROM jobs j JOIN works w ON w.key = j.key "
      "JOIN setups s ON s.hash = w.setup WHERE j.id = ?1",
      job);
  if (!r.next()) return {};
  return {r.text(0), r.text(1)};
}

}  // namespace slicecorr::farm
