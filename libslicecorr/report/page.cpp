// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "parallel/silent.hpp"
#include "picture/embed.hpp"
#include "report/page_parts.hpp"
#include "report/page_text.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/verdict.hpp"
#include "support/page/html_page.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr {

using namespace page;

namespace {

std::string counted(std::uint64_t n) { return text::count(static_cast<std::int64_t>(n)); }

std::string number_or_dash(bool known, double value, const char* unit = "") {
  return known ? text::figure(value) + unit : "-";
}

/// Where all edges have heights both say the same, of the stack and of what it is compared with.
bool surface_says_more(const ReportContent& c) {
  const auto differs = [](const Prediction& p) {
    const Histogram &a = p.height_error_um, &b = p.surface_error_um;
    return a.count() != b.count() || a.mean() != b.mean() || a.greatest() != b.greatest() ||
           a.quantile(0.95) != b.quantile(0.95);
  };
  return c.after.surface_error_um.count() > 0 &&
         (differs(c.after) || (c.before && differs(*c.before)));
}

/// The model at the brightest place, where a level step is greatest.
CureModel brightest_model(const ReportContent& c) {
  const auto& field = c.setup.printer.flat_field;
  const double factor = field ? 1.0 * field->greatest() / field->reference : 1.0;
  return make_cure_model(c.setup.printer, c.setup.resin, c.setup.process, c.info.grid.layer_um,
                         {factor, factor});
}

/// What all of it comes to, with the worst place before and after.
Markup verdict_section(const ReportContent& c, const std::vector<Markup>& figures) {
  const PrintVerdict verdict = verdict_of(c.after);
  Markup html = markup(R"(<p class="verdict {}">{}</p>)", name_of(verdict.outcome), verdict.words);
  if (const std::string worse = c.before ? worse_than_none(c.after, *c.before) : std::string();
      !worse.empty()) {
    html += markup(R"(<p class="verdict fails">{}</p>)", worse);
  }
  if (figures.empty()) return html;
  const std::size_t at = 4 * c.worst_section;
  return html + markup(R"(<div class="pair">{}{}</div><p class="dim">Section at {}.</p>)",
                       figures[at], figures[at + 1], c.sections[c.worst_section].place);
}

Table table_of_figures(const ReportContent& c) {
  Table table("figures");
  table.column("Figure");
  if (c.before) table.column("uncorrected");
  table.column("this stack");
  return table;
}

/// The figures that decide.
Markup deciding_figures(const ReportContent& c) {
  Table table = table_of_figures(c);
  const auto row = [&](const char* name, auto figure) {
    table.row(name);
    if (c.before) table.cell(figure(*c.before));
    table.cell(figure(c.after));
  };
  row("95 % of edges within", [](const Prediction& p) {
    const Histogram& errors = p.design_error_um();
    return errors.count() > 0 ? text::figure(errors.quantile(0.95)) + " um" : std::string("-");
  });
  row("Voxels that stay liquid in the part",
      [](const Prediction& p) { return counted(p.undercure_voxels); });
  row("Voxels that gel in gaps",
      [](const Prediction& p) { return counted(p.cure_through_voxels); });
  row("Gaps that close, by column",
      [](const Prediction& p) { return counted(p.merged_features) + " of " + counted(p.gaps); });
  row("Bodies that never hang on the platform", [](const Prediction& p) {
    return p.bodies ? counted(p.bodies->printed.loose_bodies) : std::string("-");
  });
  return table;
}

Markup figures_table(const ReportContent& c) {
  Table table = table_of_figures(c);
  const auto row = [&](const char* name, auto figure) {
    table.row(name);
    if (c.before) table.cell(figure(*c.before));
    table.cell(figure(c.after));
  };
  const auto errors = [&](const char* mean, const char* largest, Histogram Prediction::*of) {
    const auto um = [&](const Prediction& p, double value) {
      return number_or_dash((p.*of).count() > 0, value, " um");
    };
    row(mean, [&](const Prediction& p) { return um(p, (p.*of).mean()); });
    row("95 % of edges within", [&](const Prediction& p) { return um(p, (p.*of).quantile(0.95)); });
    row(largest, [&](const Prediction& p) { return um(p, (p.*of).greatest()); });
  };
  errors("Mean height error", "Largest height error", &Prediction::height_error_um);
  if (surface_says_more(c)) {
    errors("Mean distance of edges to the mesh", "Largest distance to the mesh",
           &Prediction::surface_error_um);
  }
  if (c.after.plane_error_um.count() > 0) {
    errors("Mean error of outlines in the plane", "Largest error in the plane",
           &Prediction::plane_error_um);
    row("Edges closed up or lost in the plane",
        [](const Prediction& p) { return fmt::format("{}, {}", p.plane_closed, p.plane_lost); });
  }
  row("Gap voxels cured through",
      [](const Prediction& p) { return counted(p.cure_through_voxels); });
  row("Feature voxels undercured", [](const Prediction& p) { return counted(p.undercure_voxels); });
  if (c.after.joints) {
    const auto joints = [&](const char* name, auto value) {
      row(name,
          [&](const Prediction& p) { return p.joints ? value(*p.joints) : std::string("-"); });
    };
    joints("Least dose at a joint",
           [](const JointFigures& j) { return number_or_dash(std::isfinite(j.least), j.least); });
    joints("Voxels that do not hold at their lift",
           [](const JointFigures& j) { return counted(j.not_holding_voxels); });
    joints("Films over gaps", [](const JointFigures& j) { return counted(j.films); });
    joints("Liquid layers over gaps, at most", [](const JointFigures& j) {
      return counted(static_cast<std::uint64_t>(j.liquid_layers_max));
    });
    joints("Mean error of edges over gaps if lifts exchange resin", [](const JointFigures& j) {
      return number_or_dash(j.exchanged_error_um.count() > 0, j.exchanged_error_um.mean(), " um");
    });
    joints("Largest error of edges over gaps if lifts exchange resin", [](const JointFigures& j) {
      return number_or_dash(j.exchanged_error_um.count() > 0, j.exchanged_max_um, " um");
    });
    joints("Mean error of edges over gaps if all resin stays", [](const JointFigures& j) {
      return number_or_dash(j.staying_error_um.count() > 0, j.staying_error_um.mean(), " um");
    });
    joints("Largest error of edges over gaps if all resin stays", [](const JointFigures& j) {
      return number_or_dash(j.staying_error_um.count() > 0, j.staying_max_um, " um");
    });
  }
  row("Column features lost",
      [](const Prediction& p) { return counted(p.lost_features) + " of " + counted(p.runs); });
  row("Column features in pieces",
      [](const Prediction& p) { return counted(p.split_features) + " of " + counted(p.runs); });
  row("Column gaps merged",
      [](const Prediction& p) { return counted(p.merged_features) + " of " + counted(p.gaps); });
  row("Gaps one slice high", [](const Prediction& p) { return counted(p.one_slice_gaps); });
  if (c.suction) {
    Markup words =
        markup("{:.4g} kPa, {:.3g} N<br>slice {}; at most {} mm/h", c.suction->suction_pa * 1e-3,
               c.suction->force_n, c.suction->slice, at_most(c.suction->speed_limit_mm_h));
    row("Greatest suction under the part", [&](const Prediction&) { return words; });
  }
  if (c.after.left_alone_voxels > 0) {
    row("Voxels left alone", [](const Prediction& p) { return counted(p.left_alone_voxels); });
  }
  row("Overlap of print and design",
      [](const Prediction& p) { return fmt::format("{:.5f}", p.iou()); });
  row("Least gap contrast", [](const Prediction& p) {
    return number_or_dash(p.gap_contrast.count() > 0, p.gap_contrast.least());
  });
  row("Dose inside, least to greatest", [](const Prediction& p) {
    return p.target_voxels ? fmt::format("{:.4g} to {:.4g}", p.min_dose_inside, p.max_dose_inside)
                           : std::string("-");
  });
  row("Least dose anywhere in features",
      [](const Prediction& p) { return number_or_dash(p.target_voxels > 0, p.min_inside_layers); });
  if (c.after.dead_zones) {
    row(c.after.flow ? "Dead zone over lit pixels, if resin stood still"
                     : "Dead zone over lit pixels",
        [](const Prediction& p) {
          if (!p.dead_zones || !std::isfinite(p.dead_zones->least())) return std::string("-");
          return fmt::format("{:.4g} to {:.4g} um", p.dead_zones->least(),
                             p.dead_zones->greatest());
        });
    row("Pixels that cure to the window", [](const Prediction& p) {
      return p.dead_zones ? fmt::format("{}", p.dead_zones->cured_pixels) : std::string("-");
    });
  }
  if (const auto& l = c.after.layerwise) {
    row("Least cure above a feature, from black light", [&](const Prediction&) {
      return fmt::format(
          "{:.4g} um{}", l->cut_through_um,
          l->max_cut_through_um > l->cut_through_um
              ? fmt::format(" ({:.4g} where exposures are longest)", l->max_cut_through_um)
              : "");
    });
    row("Gelled teeth in gaps, apart from their edges",
        [](const Prediction& p) { return fmt::format("{}", p.gap_teeth); });
    row("Greatest over least dose in a layer",
        [&](const Prediction&) { return fmt::format("{:.4g}", l->heterogeneity); });
  }
  return table +
         markup(
             R"(<p class="dim">One grey level moves the upper edge of a feature by up to {:.3g} um.</p>)",
             brightest_model(c).level_step_um());
}

/// Heights of slices; pictures draw them alike, which is said where they are not.
std::string heights_in_words(const ReportContent& c) {
  const LayerHeights& heights = c.after.heights;
  if (heights.alike()) return fmt::format("{:g}", c.info.grid.layer_um);
  const auto [least, most] = std::minmax_element(heights.um().begin(), heights.um().end());
  return fmt::format("{:g} to {:g} (sections and the view in the round draw all alike)", *least,
                     *most);
}

Markup summary(const ReportContent& c) {
  const Grid& g = c.info.grid;
  const Process& process = c.setup.process;
  const bool layerwise = process.mode == ExposureMode::layerwise;
  const int slices = c.info.recording ? c.info.recording->slices() : g.layers;
  const std::string time =
      c.info.recording ? print_time_in_words(c.info)
                       : print_time_in_words(print_time(process, c.setup.lift_times,
                                                        c.setup.resin.m, g.layer_um, g.layers));
  Markup html = markup(
      "<p>{}{} slices of {} um, {} x {} pixels of {:g} x {:g} um. {}: {}.",
      c.info.recording ? fmt::format("What a machine showed, recorded: {} images in ", g.layers)
                       : std::string(),
      slices, heights_in_words(c), g.width_px, g.height_px, g.pixel_x_um, g.pixel_y_um,
      layerwise ? fmt::format("Exposed layer by layer, {:g} s as a rule", process.exposure_s)
                : fmt::format("Printed at {:g} mm/h", process.speed_mm_h),
      time);
  if (c.info.part_volume_mm3 > 0) {
    html += fmt::format(" Resin in the part: {:.3f} ml.", c.info.part_volume_mm3 * 1e-3);
  }
  if (c.after.areas) {
    if (const auto change = c.after.areas->largest_change()) {
      html += fmt::format(
          " The lit area changes most in layer {}, at {:g} um: from {:.4g} to {:.4g} mm².",
          change->layer, change->um, change->from_mm2, change->to_mm2);
    }
    if (const auto force = c.after.areas->largest_force()) {
      html += fmt::format(" Layer {}, at {:g} um, pulls hardest at the window: {:.4g} N.",
                          force->layer, force->um, force->n);
    }
  }
  html += markup(
      R"x(</p><p class="dim">Printer {} ({} levels, {:g} to {:g} {}), resin {} (absorbance height {:g} um base 10, dose aimed at {}).)x",
      c.setup.printer.name, c.setup.printer.levels(),
      c.setup.printer.calibration.front().intensity_mw_cm2,
      c.setup.printer.calibration.back().intensity_mw_cm2, unit_of_light(c.setup.printer.unit),
      c.setup.resin.name, c.setup.resin.absorbance_height10_um, dose_in_words(c.setup.resin));
  const auto say = [&](const char* what, const std::string& words) {
    if (!words.empty()) html += fmt::format(" {}: {}.", what, words);
  };
  say("Layers are lit with", light_share_in_words(c.setup.process));
  if (!c.setup.process.lamp_share.empty()) {
    Process lamp;
    lamp.light_share = c.setup.process.lamp_share;
    say("The lamp still gives", light_share_in_words(lamp));
  }
  if (!c.setup.process.uv_lamp_share.empty()) {
    say("The UV lamp still gives",
        shares_in_words(c.setup.process.uv_lamp_share) + " of what is asked");
  }
  say("Places of pixels", distortion_in_words(c.setup.printer));
  say("Light over the display", light_in_words(c.setup.printer));
  say("Light spreads", spread_in_words(c.setup.printer.spread));
  if (const double scatter = c.setup.resin.scatter_um2_per_um; scatter > 0) {
    html += fmt::format(" Light scatters in the resin, {:g} um²/um.", scatter);
  }
  say("After printing, which these pictures do not show, the resin",
      shrinkage_in_words(c.setup.resin.shrinkage));
  say("UV light", uv_in_words(c.setup.process.uv));
  for (const std::string& sentence :
       light_notices(c.setup.printer, c.setup.resin, c.setup.process.uv.kind != UvKind::off)) {
    say("Light", sentence);
  }
  if (const std::string words =
          assumption_in_words(c.setup.printer, c.setup.resin, c.setup.process);
      !words.empty()) {
    html += markup(" <strong>Light was {}</strong>.", words);
  }
  const double cap = c.setup.process.omega_max;
  if (!layerwise) {
    html += c.most_wanted > 1 ? " Doses inside features wanted place by place."
            : cap >= kNoCap   ? " Dose inside features not capped."
                              : fmt::format(" Dose inside features capped at {:g}.", cap);
  }
  return html + markup("</p>");
}

/// The surface of the print as it is seen from below and from above.
Markup surfaces(const ReportContent& c) {
  if (!c.after.maps) return {};
  const double scale_um = 0.5 * c.info.grid.layer_um;
  Markup html = markup(
      R"(<h3>Surface from below and from above</h3><p class="key dim">As the images lie: <b><i class="flat-through"></i>{0:.3g} um and more beyond the design (red)</b> <b><i class="flat-under"></i>{0:.3g} um and more missing (blue)</b> <b><i class="designed"></i>right</b>. From below a column shows its edge nearest to the platform, from above the one farthest from it; what lies on the platform is left white. Distances are those {1}.</p>)",
      scale_um,
      c.after.surface_error_um.count() > 0 ? "from the mesh where its height is known"
                                           : "from the slices");
  for (const bool from_below : {true, false}) {
    const auto figure = [&](const Prediction& p, const char* whose) {
      if (!p.maps) return Markup();
      return detail::captioned_image(
          surface_picture(*p.maps, from_below, scale_um),
          fmt::format("{}: from {}", whose, from_below ? "below" : "above"));
    };
    html += markup(R"(<div class="pair">{}{}</div>)",
                   c.before ? figure(*c.before, "Uncorrected") : Markup(),
                   figure(c.after, "This stack"));
  }
  return html;
}

/// Four pictures of each section: what prints before and after, then the grey values.
std::vector<Markup> section_figures(const ReportContent& c, const ExecutionContext& context) {
  std::vector<Markup> figures(4 * c.sections.size());
  parallel_for(detail::silent(context), "", figures.size(), [&](std::size_t i) {
    const auto& s = c.sections[i / 4];
    const std::pair<const ColourImage&, const char*> kinds[] = {
        {s.cure_before, "Uncorrected: what would print"},
        {s.cure_after, "This stack: what will print"},
        {s.grey_before, "Uncorrected: grey values shown"},
        {s.grey_after, "This stack: grey values shown"}};
    figures[i] = detail::captioned_image(kinds[i % 4].first, kinds[i % 4].second);
  });
  return figures;
}

}  // namespace

std::string make_report(const ReportContent& c, const ExecutionContext& context) {
  const Grid& g = c.info.grid;
  const CureModel model =
      make_cure_model(c.setup.printer, c.setup.resin, c.setup.process, g.layer_um);
  Page page(c.title);
  const std::vector<Markup> figures = section_figures(c, context);
  page += verdict_section(c, figures);
  page += deciding_figures(c);
  page += summary(c);
  page += detail::uncertainty_section(c);
  page += markup("<h2>What will print</h2><details><summary>All figures</summary>{}</details>",
                 figures_table(c));
  page += detail::bodies_section(c.after);
  page += detail::dose_tables(c);
  page += detail::flow_charts(c);
  if (c.comparison) page += detail::comparison_table(*c.comparison);
  const bool moving = c.volume && c.volume->cells() > 0;
  if (moving) page += Markup::raw(detail::page_explorer_html);
  page += detail::histograms(c);
  page += detail::feature_lists(c);
  page += markup(
      R"(<h2>Still pictures</h2><p class="key dim">In the sections, platform up: <b><i class="right"></i>as designed</b> <b><i class="flat-through"></i>cured through (red)</b> <b><i class="flat-under"></i>undercured (blue)</b> <b><i class="pale"></i>designed grey</b></p>)");
  page += surfaces(c);
  for (std::size_t i = 0; i < figures.size(); i += 4) {
    const bool above = i / 4 == c.worst_section;  // what prints there is shown first
    page += markup(R"(<h3>Section at {}{}</h3><div class="pair">{}{}{}{}</div>)",
                   c.sections[i / 4].place, above ? "; what prints there is above" : "",
                   above ? Markup() : figures[i], above ? Markup() : figures[i + 1], figures[i + 2],
                   figures[i + 3]);
  }
  if (!c.column_after.empty()) {
    double top = 1;
    for (const auto* column : {&c.column_before, &c.column_after}) {
      for (const ProbeRow& row : *column) top = std::max(top, row.dose);
    }
    const std::size_t slices = std::max(c.column_before.size(), c.column_after.size());
    page += markup(
        R"(<h3>Column {}, {}</h3><p class="dim">Through the largest height error of the uncorrected part. Shaded: the design; line: dose; steps: grey level.</p>{}{})",
        c.column_x, c.column_y,
        page::drawing(column_svg(c.column_before, model, "Uncorrected", top, slices)),
        page::drawing(column_svg(c.column_after, model, "This stack", top, slices)));
  }
  page += markup(R"(<p class="dim">{}</p>)", c.info.program);
  if (moving) {
    const ReducedVolume& v = *c.volume;
    const std::array<int, 3> start{c.column_x >= 0 ? c.column_x : (v.box.x0 + v.box.x1) / 2,
                                   c.column_y >= 0 ? c.column_y : (v.box.y0 + v.box.y1) / 2,
                                   v.layers / 2};
    page.scripts("report-data", detail::page_data(v, model, g, start, context),
                 {page_inflate_js, page_round_js, detail::page_data_js, detail::page_sections_js,
                  detail::page_column_js, detail::page_solid_js, detail::page_page_js});
  }
  return page.html() + "\n";
}

std::string row_in_words(const SliceSource& source, int y) {
  const std::optional<Orientation> o = source.frame().orientation;
  if (!o) return fmt::format("image row {}", y);
  const PlatePlace place = place_on_plate(source.grid(), *o, 0, y + 0.5);
  // Portrait images have y of the plate to the left, unless they are mirrored.
  const bool falls = o->portrait != o->mirror_x;
  return fmt::format("image row {}, along {} of the plate{} at {} = {:.3f} mm", y,
                     o->portrait ? "y" : "x", falls ? " (falling to the right)" : "",
                     o->portrait ? "x" : "y", o->portrait ? place.x_mm : place.y_mm);
}

ReportContent gather_report(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                            const StackInfo& info, const Prediction& after,
                            const std::optional<Prediction>& before, const std::string& title,
                            const ExecutionContext& context,
                            std::shared_ptr<const ReducedVolume> volume) {
  ReportContent c;
  c.title = title;
  c.info = info;
  c.setup = setup;
  c.after = after;
  c.before = before;
  for (const RegionDose& r : after.regions)
    c.most_wanted = std::max(c.most_wanted, r.greatest_wanted);
  const PixelBox box = target.bounds();
  c.suction = after.suction ? after.suction
                            : print_suction(target, setup.printer, setup.resin, setup.process,
                                            setup.gap_um, detail::silent(context));
  const AsSliced uncorrected(target);
  // One section at a time: those of long prints on wide displays are large.
  const auto add_section = [&](int y) {
    constexpr int most_pixels = 900;
    const Grid& g = stack.grid();
    ReportContent::SectionPictures pictures;
    pictures.place = row_in_words(stack, y);
    const auto draw = [&](const SliceSource& shown, ColourImage& cure, ColourImage& grey) {
      const Section s = section_of(shown, target, setup, y);
      if (c.most_wanted > 1 && &shown == &stack) {
        pictures.dose_wanted =
            dose_picture(s, true, c.most_wanted, g.pixel_x_um, g.layer_um, most_pixels);
        pictures.dose_after =
            dose_picture(s, false, c.most_wanted, g.pixel_x_um, g.layer_um, most_pixels);
      }
      cure = cure_picture(s, g.pixel_x_um, g.layer_um, most_pixels);
      grey = grey_picture(s, g.pixel_x_um, g.layer_um, most_pixels);
    };
    // Both at once, where that is not much memory.
    ExecutionContext two = detail::silent(context);
    if (static_cast<double>(g.width_px) * g.layers >= 32e6) two.threads = 1;
    parallel_for(two, "", 2, [&](std::size_t i) {
      if (i == 0) {
        draw(uncorrected, pictures.cure_before, pictures.grey_before);
      } else {
        draw(stack, pictures.cure_after, pictures.grey_after);
      }
    });
    c.sections.push_back(std::move(pictures));
  };
  const int middle = (box.y0 + box.y1) / 2;
  if (!box.empty()) add_section(middle);
  const Prediction& worst = before ? *before : after;
  if (worst.worst_x >= 0) {
    if (worst.worst_y != middle) add_section(worst.worst_y);
    c.worst_section = c.sections.size() - 1;
    c.column_x = worst.worst_x;
    c.column_y = worst.worst_y;
    c.column_before = probe_stack(uncorrected, &target, setup, c.column_x, c.column_y);
    c.column_after = probe_stack(stack, &target, setup, c.column_x, c.column_y);
  }
  const int hanging = detail::row_of_bodies(after);
  if (hanging >= 0 && hanging != middle && hanging != worst.worst_y) {
    add_section(hanging);
    if (after.bodies->printed.loose_bodies > 0) c.worst_section = c.sections.size() - 1;
  }
  // What can be moved through computes with one image per slice.
  if (!volume && !stack.recording()) {
    volume =
        std::make_shared<ReducedVolume>(reduce_volume(stack, target, setup, kReportCells, context));
  }
  c.volume = std::move(volume);
  return c;
}

}  // namespace slicecorr
