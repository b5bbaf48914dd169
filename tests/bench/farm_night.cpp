// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A night in small: farm_night [JOBS] [SIZE_MM] [local|slurm]. Many jobs from real meshes, sound
// and broken ones, with several resins and speeds, by slicefarm and one after the other by
// slicecorr; then the same jobs again. Fails when a job fails, is done twice, is not what the
// record says, or differs from what slicecorr wrote. With slurm, the work runs on two virtual nodes
// of one core each, and daemons of Slurm are killed in the middle of it. Where the folder of real
// data is not there, the meshes in tests/data are all.

#include <fmt/format.h>
#include <stdlib.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <thread>

#include "../real_files.hpp"
#include "../run_program.hpp"
#include "../slurm_cluster.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/mesh.hpp"

namespace {

namespace fs = std::filesystem;
using namespace slicecorr;
using namespace slicecorr::farm;

struct Cost {
  double wall_s = 0, cpu_s = 0;
};

double cpu_of_children() {
  rusage u{};
  ::getrusage(RUSAGE_CHILDREN, &u);
  return static_cast<double>(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

Cost run(const std::vector<std::string>& command) {
  const double cpu = cpu_of_children();
  const auto begin = std::chrono::steady_clock::now();
  test::RunOptions o;
  o.timeout = std::chrono::hours(10);
  const test::RunResult r = test::run_program(command, o);
  if (r.exit_code != 0) throw std::runtime_error(command[0] + " " + command[1] + ": " + r.err);
  return {std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(),
          cpu_of_children() - cpu};
}

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(file), {});
}

/// Runs the farm on virtual nodes; controller and nodes are killed each time that some more of the
/// jobs are done, by turns.
Cost run_on_slurm(const std::string& bin, const std::string& dir, const std::string& folder,
                  int jobs, int& kills) {
  test::SlurmCluster cluster(folder + "/slurm", 2, 1);
  ::setenv("SLURM_CONF", cluster.configuration().c_str(), 1);
  const double cpu = cpu_of_children();
  const auto begin = std::chrono::steady_clock::now();
  std::jthread killer([&](const std::stop_token& stop) {
    ReadModel model(dir + "/farm.sqlite");
    const int turns = 8;
    for (int turn = 1; turn <= turns; ++turn) {
      const std::int64_t at = std::int64_t{jobs} * turn / (turns + 1);
      while (model.summary().jobs[static_cast<std::size_t>(JobState::done)] < at) {
        if (stop.stop_requested()) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
      const std::string what[] = {"controller", "node n1", "controller", "node n2"};
      cluster.tell("stop-" + what[turn % 4]);
      cluster.tell("start-" + what[turn % 4]);
      ++kills;
    }
  });
  run({bin + "slicefarm", "run", "--until-empty", "--dir", dir, "--engine", "slurm",
       "--slurm-poll-s", "0.5"});
  killer.request_stop();
  killer.join();
  const double wall =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  // Workers are not our children; what they took is in the record.
  return {wall, cpu_of_children() - cpu};
}

struct Part {
  std::string path;
  double scale;
};

/// Every job is done by one attempt, said so once, and its files are those of the record.
void check_record(ReadModel& model, int jobs) {
  JobFilter filter;
  filter.limit = jobs + 1;
  const std::vector<farm::Job> list = model.jobs(filter);
  if (list.size() != static_cast<std::size_t>(jobs)) throw std::runtime_error("jobs are missing");
  for (const farm::Job& j : list) {
    std::int64_t ends = 0;
    for (const FarmEvent& e : model.events(0, 1000, j.id)) ends += e.kind == "done";
    if (ends != 1 || model.attempts(j.id).size() != 1) {
      throw std::runtime_error(fmt::format("{}: done {} times", j.name, ends));
    }
    if (j.files.size() != 4) throw std::runtime_error(j.name + ": files are missing");
    for (const ResultFile& f : j.files) {
      const ResultFile now = sha256_of_file(j.output(f.ending));
      if (now.sha256 != f.sha256 || now.bytes != f.bytes) {
        throw std::runtime_error(fmt::format("{}: {} is not what was recorded", j.name, f.ending));
      }
    }
  }
}

}  // namespace

int main(int argc, char** argv) try {
  const int jobs = argc > 1 ? std::atoi(argv[1]) : 200;
  const double size_mm = argc > 2 ? std::atof(argv[2]) : 5;
  const bool slurm = argc > 3 && std::string(argv[3]) == "slurm";
  const std::string bin = fs::read_symlink("/proc/self/exe").parent_path().string() + "/";
  std::vector<Part> parts;
  // The broken ones have holes, turned triangles, bodies that cut or touch each other.
  for (const char* name :
       {"clean/3DBenchy.stl", "clean/UVtools_demo_file.stl", "clean/cgal_femur.off",
        "clean/cgal_turbine.off", "clean/ksr_fdmtest_v4.stl", "clean/photonic3d_lenscap-36mm.stl",
        "clean/stanford_bunny_7k_closed.off", "clean/tpms_diamond_51.stl",
        "dirty/admesh_block_fill-holes-bad.stl", "dirty/admesh_block_normal-directions-bad.stl",
        "dirty/assimp_sphereWithHole.stl", "dirty/cgal_blobby-shuffled.off",
        "dirty/cgal_elephant-with-holes.off", "dirty/manifold_self_intersectA.obj",
        "dirty/trimesh_cycloidal_touching_bodies.ply", "dirty/trimesh_multibody.stl",
        "dirty/trimesh_wallhole.obj"}) {
    const std::string mesh = test::real_file(std::string("meshes/") + name);
    if (!fs::exists(mesh) && !fs::exists(SLICECORR_TEST_DATA)) continue;
    const MeshReport r = inspect(read_mesh(mesh));
    const double longest =
        std::max({r.upper[0] - r.lower[0], r.upper[1] - r.lower[1], r.upper[2] - r.lower[2]});
    parts.push_back({mesh, size_mm / longest});
  }
  if (parts.size() < 7) {
    fmt::print("skipped: no folder of real data beside tests/data: {}\n", SLICECORR_TEST_DATA);
    return 77;
  }
  // Resins and speeds that can print at all on this printer.
  const std::string printer = "dual-wavelength-dlp", layer = "50";
  std::string folder = (fs::temp_directory_path() / "farm-night-XXXXXX").string();
  if (!::mkdtemp(folder.data())) return 2;
  struct Mix {
    std::string resin, speed;
  };
  std::vector<Mix> mixes;
  for (const char* resin : {"benchy-resin", "egg-resin", "custom-resin-1", "custom-resin-2"}) {
    for (int speed = 300; speed <= 1500; speed += 100) {
      test::RunOptions o;
      const std::string s = std::to_string(speed);
      const test::RunResult r = test::run_program(
          {bin + "slicefarm", "submit", "--dry-run", "--dir", folder + "/probe", parts[6].path,
           "--scale", fmt::format("{}", parts[6].scale), "--printer", printer, "--layer-um", layer,
           "--resin", resin, "--speed-mm-h", s},
          o);
      if (r.exit_code == 0) mixes.push_back({resin, s});
    }
  }
  const std::size_t most = mixes.size() * parts.size();
  if (most < static_cast<std::size_t>(jobs)) {
    throw std::runtime_error(fmt::format("only {} different jobs", most));
  }
  // Of all resins and speeds, also where there are more than the jobs need.
  const std::size_t used = (static_cast<std::size_t>(jobs) + parts.size() - 1) / parts.size();
  const std::size_t stride = mixes.size() / used;
  const std::string table = folder + "/jobs.csv";
  {
    std::ofstream file(table);
    file << "part,scale,resin,speed_mm_h,name,out\n";
    for (int i = 0; i < jobs; ++i) {
      const auto n = static_cast<std::size_t>(i);
      const Part& p = parts[n % parts.size()];
      const Mix& m = mixes[n / parts.size() * stride];
      file << fmt::format("{},{},{},{},job-{},farm\n", p.path, p.scale, m.resin, m.speed, i);
    }
  }
  const auto cores = static_cast<double>(std::max(1u, std::thread::hardware_concurrency()));
  fmt::print("{} jobs of {} parts and {} pairs of resin and speed, {:g} mm\n\n", jobs, parts.size(),
             used, size_mm);
  fmt::print("| | wall | processor | cores busy | per job |\n|---|---|---|---|---|\n");
  const auto row = [&](const char* what, const Cost& c) {
    fmt::print("| {} | {:.1f} s | {:.1f} s | {:.0f} % | {:.0f} ms |\n", what, c.wall_s, c.cpu_s,
               100 * c.cpu_s / c.wall_s / cores, 1000 * c.wall_s / jobs);
    std::fflush(stdout);
  };
  const std::string dir = folder + "/farm-dir";
  const Cost submitted = run({bin + "slicefarm", "submit", table, "--dir", dir, "--printer",
                              printer, "--layer-um", layer});
  row("slicefarm submit: checks, copies, queues", submitted);
  int kills = 0;
  Cost farmed = slurm ? run_on_slurm(bin, dir, folder, jobs, kills)
                      : run({bin + "slicefarm", "run", "--until-empty", "--dir", dir});
  ReadModel model(dir + "/farm.sqlite");
  const Summary summary = model.summary();
  std::int64_t lost = 0, twice = 0;
  for (int id = 1; slurm && id <= jobs; ++id) {
    int good = 0;
    for (const Attempt& a : model.attempts(id)) {
      good += a.reason == Reason::none;
      lost += a.reason != Reason::none;
      farmed.cpu_s += a.cpu_s;
    }
    twice += good != 1;
  }
  row("slicefarm run", farmed);
  if (summary.jobs[static_cast<std::size_t>(JobState::done)] != jobs || twice > 0 ||
      summary.attempts != jobs + lost) {
    throw std::runtime_error(fmt::format("{} of {} jobs done, {} attempts",
                                         summary.jobs[static_cast<std::size_t>(JobState::done)],
                                         jobs, summary.attempts));
  }
  check_record(model, jobs);
  // The same by hand: one program after the other, each on all cores.
  fs::create_directories(folder + "/direct");
  Cost direct;
  for (int i = 0; i < jobs; ++i) {
    const auto n = static_cast<std::size_t>(i);
    const Part& p = parts[n % parts.size()];
    const Mix& m = mixes[n / parts.size() * stride];
    const std::string out = fmt::format("{}/direct/job-{}", folder, i);
    const Cost c = run({bin + "slicecorr", "run", p.path, "--scale", fmt::format("{}", p.scale),
                        "-o", out + ".uvj", "--printer", printer, "--resin", m.resin,
                        "--speed-mm-h", m.speed, "--layer-um", layer, "--quiet"});
    direct.wall_s += c.wall_s;
    direct.cpu_s += c.cpu_s;
    for (const char* ending : {".uvj", ".html", ".json"}) {
      if (bytes_of(fmt::format("{}/farm/job-{}{}", folder, i, ending)) != bytes_of(out + ending)) {
        throw std::runtime_error(fmt::format("job {}: {} differs", i, ending));
      }
    }
  }
  row("slicecorr run, one after the other", direct);
  // The same jobs again, into other places.
  std::string again = bytes_of(table);
  for (std::size_t at = 0; (at = again.find(",farm\n", at)) != again.npos; at += 6) {
    again.replace(at, 6, ",more\n");
  }
  std::ofstream(folder + "/again.csv") << again;
  const Cost cached = run({bin + "slicefarm", "submit", folder + "/again.csv", "--dir", dir,
                           "--printer", printer, "--layer-um", layer});
  row("slicefarm submit of the same again", cached);
  const Summary after = ReadModel(dir + "/farm.sqlite").summary();
  if (after.from_cache != jobs) throw std::runtime_error("not all of them came from the cache");

  if (slurm) {
    fmt::print("\n{} kills of daemons of Slurm, {} attempts given up and made again\n", kills,
               lost);
  }
  fmt::print(
      "\nAll done, none twice, every file as recorded and byte for byte as slicecorr writes it.\n"
      "{:.0f} jobs an hour, {:.0f} one after the other: {:.2f} times as many, {:.2f} times with "
      "the submission.\nThe farm costs {:.0f} ms of processor time a job while it runs, and {:.0f} "
      "ms to submit one.\n",
      3600 * jobs / farmed.wall_s, 3600 * jobs / direct.wall_s, direct.wall_s / farmed.wall_s,
      direct.wall_s / (farmed.wall_s + submitted.wall_s),
      1000 * (farmed.cpu_s - direct.cpu_s) / jobs, 1000 * submitted.cpu_s / jobs);
  fs::remove_all(folder);
  return 0;
} catch (const std::exception& e) {
  fmt::print(stderr, "farm_night: {}\n", e.what());
  return 1;
}
