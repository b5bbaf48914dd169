// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program `slicefarm`: parses, calls the library and prints.

#include "commands.hpp"

int main(int argc, char** argv) {
  using namespace slicecorr;
  cli::Program program(
      "slicefarm",
      "Corrects many parts unattended: a durable queue, workers that may crash, results that are "
      "kept and checked.",
      "slicefarm submit *.stl --printer dual-wavelength-dlp --resin benchy-resin --layer-um 50 "
      "--speed-mm-h 800 --out corrected && slicefarm run --until-empty");
  farm::add_submit_commands(program);
  farm::add_run_commands(program);
  farm::add_status_commands(program);
  farm::add_follow_commands(program);
  farm::add_control_commands(program);
  farm::add_scan_commands(program);
  farm::add_machine_commands(program);
  program.examples({
      {"run", "slicefarm run --until-empty"},
      {"nodes", "slicefarm nodes"},
      {"status", "slicefarm status --state failed"},
      {"logs", "slicefarm logs 12"},
      {"watch", "slicefarm watch"},
      {"report", "slicefarm report --since 20:00 -o morning.html"},
      {"serve", "slicefarm serve --listen 127.0.0.1:8420"},
      {"notify", "slicefarm notify --test"},
      {"cancel", "slicefarm cancel 12 13"},
      {"retry", "slicefarm retry 12"},
      {"priority", "slicefarm priority 12 --to 5 --ready-by 07:00"},
      {"set", "slicefarm set night=20:00-07:00 user-running=2"},
      {"scan", "slicefarm scan 12 scan.ply --unit mm"},
      {"scans", "slicefarm scans --html drift.html"},
      {"next", "slicefarm next 12"},
      {"pause", "slicefarm pause"},
      {"drain", "slicefarm drain"},
      {"resume", "slicefarm resume"},
      {"machines discover", "slicefarm machines discover"},
      {"machines add",
       "slicefarm machines add saturn-1 --kind sdcp3 --address 192.168.1.40 --format goo"},
      {"machines list", "slicefarm machines list"},
      {"machines test", "slicefarm machines test saturn-1 part.goo"},
      {"machines send", "slicefarm machines send 12 saturn-1"},
      {"machines start", "slicefarm machines start saturn-1 --plate-is-empty --vat-is-filled"},
      {"machines pause", "slicefarm machines pause saturn-1"},
      {"machines resume", "slicefarm machines resume saturn-1"},
      {"machines stop", "slicefarm machines stop saturn-1"},
      {"machines cleared", "slicefarm machines cleared saturn-1"},
      {"machines watch", "slicefarm machines watch saturn-1"},
      {"gc", "slicefarm gc --older-than-days 30 --dry-run"},
  });
  return program.run(argc, argv);
}
