// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo_views.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/tomo/report.hpp"
#include "slicecorr/tomo/section.hpp"
#include "slicecorr/tomo/video.hpp"
#include "slicecorr/vial.hpp"
#include "video_file.hpp"

namespace slicecorr::cli {

namespace {

int section(const TomoViewOptions& o, const ExecutionContext& context, Console& console) {
  const SectionsFile file = sections_file(o.output);
  check_output(o.output, {o.job});
  const tomo::Printed print = tomo::printed(tomo::read_job(o.job, context), context);
  std::vector<tomo::Plane> planes;
  for (const auto& [axis, at] :
       {std::pair{tomo::Axis::x, o.x_mm}, {tomo::Axis::y, o.y_mm}, {tomo::Axis::z, o.z_mm}}) {
    if (at) planes.push_back({axis, *at});
  }
  if (planes.empty()) planes = tomo::middle_planes(print);
  const auto sections = tomo::sections_of(print, planes);
  const tomo::ColouredBy by = o.show == "print"    ? tomo::ColouredBy::print
                              : o.show == "target" ? tomo::ColouredBy::target
                                                   : tomo::ColouredBy::dose;
  const std::string title =
      fmt::format("{}: {} of the print", std::filesystem::path(o.job).filename().string(),
                  by == tomo::ColouredBy::target  ? "target"
                  : by == tomo::ColouredBy::print ? "gel"
                                                  : "dose");
  write_text_file(o.output, file(sections, by, title));
  std::string text = o.output + ":";
  for (const tomo::PrintSection& s : sections) {
    text += fmt::format("{} {} = {:.3f} mm ({} voxels missing, {} gelled that should not)",
                        &s == &sections.front() ? "" : ",", "xyz"[static_cast<int>(s.axis)],
                        s.at_mm, s.missing(), s.gelled());
  }
  console.say(text);
  return kDone;
}

int report(const TomoViewOptions& o, const ExecutionContext& context, Console& console) {
  ending_of(o.output, {".html"});
  check_output(o.output, {o.job});
  const tomo::Printed print = tomo::printed(tomo::read_job(o.job, context), context);
  write_text_file(o.output, tomo::report_page(
                                print, std::filesystem::path(o.job).filename().string(), context));
  console.say(fmt::format("{}: contrast {:.4g}, {} void voxels gel with the part", o.output,
                          print.figures.metrics.contrast, print.figures.metrics.void_gelled));
  return kDone;
}

VideoChannel channel_named(const std::string& name) {
  if (name == "red") return VideoChannel::red;
  if (name == "green") return VideoChannel::green;
  if (name == "blue") return VideoChannel::blue;
  return VideoChannel::all;
}

/// Players turn the vial as fast as a name like part_9rpm.mp4 says: it has to be right.
void check_said_speed(const std::string& output, const tomo::VideoPlan& plan) {
  const std::string name = std::filesystem::path(output).filename().string();
  const std::size_t end = name.rfind("rpm");
  if (end == std::string::npos) return;
  std::size_t begin = end;
  while (begin > 0 && (std::isdigit(static_cast<unsigned char>(name[begin - 1])) != 0 ||
                       name[begin - 1] == '.')) {
    --begin;
  }
  double said = 0;
  const char *const first = name.data() + begin, *const last = name.data() + end;
  const auto [stop, error] = std::from_chars(first, last, said);
  if (error != std::errc{} || stop != last) return;
  const double rpm = plan.deg_s / 6;
  if (std::abs(said - rpm) <= 0.005 * rpm) return;
  throw InputError(
      output, "",
      fmt::format("says {:g} rpm, and the vial must turn at {:.4g} for images that fall "
                  "on their angles; expected that number, or --fps {:.6g}",
                  said, rpm, plan.fps() * said / rpm));
}

int video(const TomoViewOptions& o, const ExecutionContext& context, Console& console) {
  const std::string ending = ending_of(o.output, {".y4m", ".mkv", ".mp4"});
  check_output(o.output, {o.job});
  if (o.channel != "all" && ending != ".mkv") {
    throw InputError(fmt::format(
        "--channel {} is for .mkv, whose pixels have colours of their own: .y4m here is grey, and "
        ".mp4 (yuv420p) has one colour for four pixels",
        o.channel));
  }
  const tomo::TomoJob job = tomo::read_job(o.job, context);
  const tomo::VideoPlan plan = tomo::plan_video(job, o.video);
  check_said_speed(o.output, plan);
  if (ending == ".mp4" && (plan.width_px % 2 != 0 || plan.height_px % 2 != 0)) {
    throw InputError(fmt::format(
        "images of {} x {} pixels are not for .mp4 (yuv420p), which takes even numbers; expected a "
        "name that ends in .mkv or .y4m",
        plan.width_px, plan.height_px));
  }
  const std::unique_ptr<VideoFile> file =
      ending == ".y4m"   ? make_y4m_file(o.output)
      : ending == ".mp4" ? make_mp4_file(o.output)
                         : make_matroska_file(o.output, channel_named(o.channel));
  tomo::write_y4m(
      job, plan, [&](const std::uint8_t* bytes, std::size_t count) { file->put(bytes, count); },
      context);
  file->publish();
  console.say(fmt::format(
      "{}: {} images of {} x {} pixels, {:.6g} a second, {:.1f} s: {} turn{}, then {} black; the "
      "vial must turn {} at {:.6g} degrees a second, {:.4g} rpm",
      o.output, plan.images, plan.width_px, plan.height_px, plan.fps(), plan.time_s(), plan.turns,
      plan.turns == 1 ? "" : "s", plan.tail, name_of(job.printer.rotation->direction), plan.deg_s,
      plan.deg_s / 6));
  return kDone;
}

int convert(const TomoViewOptions& o, const ExecutionContext& context, Console& console) {
  check_output(o.output, {o.images.path, o.part});
  if (!o.part.empty() && o.voxel_mm <= 0) {
    throw InputError("--part-npy does not say how large its voxels are; expected --voxel-mm");
  }
  tomo::ImageSequence images = o.images;
  if (!o.direction.empty()) {
    images.direction =
        o.direction == "clockwise" ? TurnDirection::clockwise : TurnDirection::counterclockwise;
  }
  const tomo::Box<std::uint8_t> part =
      o.part.empty() ? tomo::Box<std::uint8_t>{} : tomo::read_part_npy(o.part);
  const Printer printer = load_printer(o.printer);
  const Resin resin = load_resin(o.resin);
  for (const std::string& text : o.light.checked(printer, resin)) context.tell(text);
  const tomo::TomoJob job = tomo::job_of_images(images, printer, resin, part, o.voxel_mm, context);
  tomo::write_job(o.output, job, context);
  console.say(fmt::format(
      "{}: {} frames, {} slices of {:g} mm{}", o.output, job.sampling.angles, job.sampling.slices,
      job.sampling.voxel_mm,
      o.part.empty() ? fmt::format("; no part: to be judged by a volume of {} slices (tomo verify "
                                   "--volume), or convert with --part-npy",
                                   job.sampling.slices)
                     : std::string()));
  return kDone;
}

}  // namespace

SectionsFile sections_file(const std::string& output) {
  return ending_of(output, {".png", ".svg"}) == ".svg" ? tomo::sections_svg : tomo::sections_png;
}

void check_picture_name(const std::string& path) { sections_file(path); }

std::string picture_of(const tomo::Evidence& evidence, const std::string& part,
                       const std::string& path) {
  const tomo::PrintSection section = tomo::section_of(evidence);
  write_text_file(path, sections_file(path)(
                            {section}, tomo::ColouredBy::dose,
                            fmt::format("{}: slice {} can't be printed", part, evidence.slice)));
  return fmt::format(
      "{} shows that slice with the best light found, at a gel dose between the part's least dose "
      "and void's most: {} voxels of the part miss it, {} of void reach it",
      path, section.missing(), section.gelled());
}

void add_tomo_views(Program& program, CLI::App* group, TomoViewOptions& o) {
  using Command = int (*)(const TomoViewOptions&, const ExecutionContext&, Console&);
  const auto add = [&](const char* name, const char* text, Command command) {
    return program.add_to(group, name, text,
                          [&o, command](const ExecutionContext& context, Console& console) {
                            return command(o, context, console);
                          });
  };
  const CLI::Validator any_mm =
      number_in(-std::numeric_limits<double>::max(), std::numeric_limits<double>::max());
  CLI::App* sub =
      add("section", "Draw the dose of a job's print against its target, cut open, as PNG or SVG",
          section);
  sub->add_option("JOB", o.job, "File of the job (.frames)")->required();
  sub->add_option(
         "--x-mm", o.x_mm,
         "Cut where x has this value, from the axis [all three, through the part's middle]")
      ->check(any_mm);
  sub->add_option("--y-mm", o.y_mm, "Cut where y has this value, from the axis")->check(any_mm);
  sub->add_option("--z-mm", o.z_mm, "Cut where z has this value, upwards from the optical axis")
      ->check(any_mm);
  sub->add_option("--show", o.show, "What voxels are coloured by: dose, what gels, what should")
      ->check(CLI::IsMember({"dose", "print", "target"}))
      ->capture_default_str();
  sub->add_option("-o,--output", o.output, "Picture to write (.png or .svg)")->required();

  sub = add("report", "Write a page that shows what a job prints", report);
  sub->add_option("JOB", o.job, "File of the job (.frames)")->required();
  sub->add_option("-o,--output", o.output, "Page to write (.html)")->required();

  sub = add("video", "Write a job's frames as a video, turn by turn", video);
  sub->add_option("JOB", o.job, "File of the job (.frames)")->required();
  sub->add_option("--turns", o.video.turns, "Turns to show [those of the job]")
      ->check(CLI::Range(1, 1000000000));
  sub->add_option("--fps", o.video.fps,
                  "Images a second [as the job shows them]: the vial must turn at this over the "
                  "frames of a turn")
      ->check(number_above_zero());
  sub->add_option("--channel", o.channel,
                  "Light of the projector that shows them, in .mkv: all of it, or one colour")
      ->check(CLI::IsMember({"all", "red", "green", "blue"}))
      ->capture_default_str();
  sub->add_option("--tail-s", o.video.tail_s, "Black after the last turn")
      ->check(number_in(0, 86400))
      ->capture_default_str();
  sub->add_option("-o,--output", o.output,
                  "Video to write: .y4m, or .mkv and .mp4 where the program ffmpeg is installed; "
                  ".mp4 loses a little, the others nothing")
      ->required();

  sub =
      add("convert", "Make a job of images that others made, to be judged and looked at", convert);
  sub->add_option("FOLDER", o.images.path,
                  "Folder (or zip) of PNG images, one for each angle, in the order of their names")
      ->check(value_is(ValueKind::file))
      ->required();
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  o.light.add_to(*sub);
  sub->add_option("--angle-step-deg", o.images.angle_step_deg, "Angle from image to image")
      ->required()
      ->check(number_above_zero());
  sub->add_option("--turns", o.images.turns, "Turns for which they are shown")
      ->required()
      ->check(CLI::Range(1, 1000000000));
  sub->add_option("--direction", o.direction,
                  "How the vial turns while they are shown, seen from above [as the printer's]")
      ->check(CLI::IsMember({"clockwise", "counterclockwise"}));
  sub->add_option("--part-npy", o.part,
                  "What should print (.npy, axes z, y, x: 255 part, 0 empty, else neither)");
  sub->add_option("--voxel-mm", o.voxel_mm, "Side of a voxel [the height of the images' rows]")
      ->check(number_above_zero());
  sub->add_option("-o,--output", o.output, "File of the job to write (.frames)")->required();
}

}  // namespace slicecorr::cli
