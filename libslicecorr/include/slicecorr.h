// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/**
 * @file slicecorr.h
 * The C interface of slicecorr: what a slicer links to correct its slices before it writes them, or
 * the archive that it wrote; and the operators and solvers of tomographic printing. C99 or later, C++
 * too. Link libslicecorr.so (pkg-config slicecorr, or CMake's slicecorr::c). A tour with examples is
 * docs/c-api.md; Python has a module on top of it, docs/python.md.
 *
 * Terms. A *stack* is a pile of 8-bit slices with what is known of them; slice 0 is the first one
 * shown, next to the build platform. A *target* says what is to be printed: 255 is a pixel filled
 * with the part, 0 an empty one, between them the share of its area. A *corrected* stack says what
 * is to be shown: grey levels of one printer, in the scale 0..255. A *setup* is printer, resin and
 * process. *Figures* are what a stack will print, measured against its target. The dose models and
 * corrections are those of Pritchard, "Modeling Reaction and Transport Effects in Stereolithographic
 * 3D Printing" (University of Michigan, 2020), chapter II and appendix A.
 *
 * Units are in the names: um, mm_h (mm per hour), s, mj_cm3 (mJ/cm³), mw_cm2 (mW/cm²). Texts are
 * UTF-8 and end with 0, numbers in texts have a decimal point whatever the locale. Paths are the
 * bytes that the system takes.
 *
 * Errors. Functions that can fail return a slicecorr_status. No exception leaves the library, it
 * prints nothing, never ends the process and sets no signal handler. The text of the last failure in
 * this thread is slicecorr_error_text(); setups and jobs keep their own, too. After an error every
 * handle can be used on or freed, and handles that the call should have given are NULL.
 *
 * Ownership. What slicecorr_*_new, _open, _create or an output argument gives is the caller's and is
 * freed by the _free function of its type, which takes NULL, too. Texts that functions return belong
 * to their handle and live until it is freed or changed. What the caller passes in is copied or used
 * during the call only.
 *
 * Threads. Different handles may be used in different threads at once. A setup may be read, but not
 * changed, by several at once; a job is for one call at a time, except slicecorr_job_cancel(). A
 * stack may be used by several threads at once, and filled by several with different slices, but not
 * filled, loaded or changed while it is used. Figures and lists never change. Results do not depend
 * on the number of threads.
 *
 * Lasting. Functions, names of settings, codes and structs keep their meaning; new ones are added,
 * and slicecorr_abi_version() counts that. Structs begin with their size as the caller knows it, so
 * they can grow. What breaks this gets a new file name (libslicecorr.so.1).
 */
#ifndef SLICECORR_H
#define SLICECORR_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define SLICECORR_API __attribute__((visibility("default")))
#else
#define SLICECORR_API
#endif

/* ---- Version and errors ---------------------------------------------------------------------- */

/** What this header describes; see slicecorr_abi_version(). */
#define SLICECORR_ABI_VERSION 2

/** The result of a call. Up to 130 the same numbers as the exit codes of the programs. */
typedef int slicecorr_status;
enum {
  SLICECORR_OK = 0,
  SLICECORR_DEFECT = 1,        /**< a defect of the library; please report its text */
  SLICECORR_BAD_INPUT = 2,     /**< an input that can't be read, is out of range or does not fit */
  SLICECORR_INFEASIBLE = 3,    /**< physics forbids it; the text says what would make it feasible */
  SLICECORR_DEVICE = 4,        /**< disk full or unwritable, out of memory */
  SLICECORR_MISSED = 5,        /**< a figure is beyond the limit that was asked for */
  SLICECORR_CANCELLED = 130,   /**< the caller stopped it; nothing half-made is left */
  SLICECORR_BAD_CALL = 200,    /**< the calling program is wrong: NULL, a struct of no known size */
  SLICECORR_UNKNOWN_NAME = 201 /**< a name that this version does not know */
};

/** Version of the library, "0.1.0". */
SLICECORR_API const char* slicecorr_version(void);
/** Rises by one whenever something is added. A program built with this header runs with every
 *  library whose number is at least SLICECORR_ABI_VERSION and whose file name is the same. */
SLICECORR_API int slicecorr_abi_version(void);
/** A few words for a status, "physically infeasible"; never NULL. */
SLICECORR_API const char* slicecorr_status_text(slicecorr_status status);
/** Why the last call in this thread that returns a status failed: what, where, what was expected
 *  instead. "" when it did not fail; never NULL. Lives until the thread's next such call. */
SLICECORR_API const char* slicecorr_error_text(void);

/* ---- Lists ------------------------------------------------------------------------------------ */

/** Names and what they stand for. */
typedef struct slicecorr_list slicecorr_list;

/** Lists what there is of a kind: "printer" and "resin" (definitions found in $SLICECORR_DB, the
 *  user's folder and the installed database; text: path), "format" (archives; text: what it is and
 *  its endings), "setting" (of setups; text: what it means), "property" (of stacks), "figure" (of stacks),
 *  "bench_property", "tomo_property" and "tomo_figure" (of tomographic benches and jobs).
 *  SLICECORR_UNKNOWN_NAME for other kinds. */
SLICECORR_API slicecorr_status slicecorr_list_new(const char* kind, slicecorr_list** list);
SLICECORR_API size_t slicecorr_list_count(const slicecorr_list* list);
/** NULL when `index` is not below the count. */
SLICECORR_API const char* slicecorr_list_name(const slicecorr_list* list, size_t index);
SLICECORR_API const char* slicecorr_list_text(const slicecorr_list* list, size_t index);
SLICECORR_API void slicecorr_list_free(slicecorr_list* list);

/* ---- Setups: printer, resin, process ---------------------------------------------------------- */

typedef struct slicecorr_setup slicecorr_setup;

/** An empty setup; NULL when there is no memory. */
SLICECORR_API slicecorr_setup* slicecorr_setup_new(void);
SLICECORR_API void slicecorr_setup_free(slicecorr_setup* setup);

/** Sets one setting. Names are those of the program's options with _ for -; NULL or "" takes a
 *  setting back. Numbers may be given as text, too: "800", or "inf" for omega_max.
 *
 *  Those of printer, resin and process are the table of docs/settings.md, which `slicecorr settings`
 *  prints and slicecorr_list_new("setting") gives; lists (slice_speed_mm_h, layer_exposure_s) are set
 *  with slicecorr_setup_set_numbers(). Beside them:
 *
 *  leave_alone           mesh on the plate, or stack like the target, of what is shown as it is sliced
 *  part_inside           paths of meshes, one a line, that the archive was sliced from, as they stand on
 *                        their supports: they are found there in all their copies, and what it lights
 *                        outside of them, supports and rafts, is left alone. A mesh that is not there
 *                        is SLICECORR_BAD_INPUT, also of slicecorr_check()
 *  units                 auto, mm, inch, m: unit of these meshes
 *  scale, fit_mm         factor of their size, or longest side of all of them together
 *  rotate_deg            three numbers: by how much they are turned about x, y and z, in this order
 *  uncertain             by how much inputs may be off, as standard deviations: ha=5%,dc=5%, or fit
 *                        for what the resin's file says; predictions then say how sure they are
 *  robust                on, off: corrections keep features and gaps for all that uncertain names
 *  tolerance_um, gap_contrast   what slicecorr_plan() is to keep
 *  design                path of the mesh that was sliced, which slicecorr_scan_compare() measures by, too;
 *                        units, scale, fit_mm and rotate_deg are then of this mesh
 *  scan_unit             unit of a scan's numbers: auto, um, mm, cm, inch, m
 *  voxel_um              side of a voxel of a scan that is a volume
 *
 *  Tomographic printing looks at printer and resin, at what changes the resin (dc_mj_cm3, ha_um,
 *  dose_factor), and at these, which other calls don't look at:
 *
 *  voxel_mm              side of a voxel
 *  angles                frames of a turn; as many as resolve the voxels when not set
 *  method                ladder, osmo, kelly, fbp: how light is found
 *  window                hamming, ram-lak, kelly: of the filter that it starts from
 *  iterations            steps, with the ladder of each rung; 60, 20, 10 when not set
 *  clip_sigma            osmo: cuts off light above the mean and so many standard deviations
 *  stop_error            osmo: stops when doses are wrong by less than this share of the part's
 *  max_time_s            time to print: the ladder keeps light within it; what takes longer is
 *                        SLICECORR_INFEASIBLE
 *  beyond_reach          refuse, allow: parts that reach further than light from all directions
 *
 *  Values are checked here as far as they can be alone: SLICECORR_BAD_INPUT. What belongs together
 *  is checked when the setup is used. */
SLICECORR_API slicecorr_status slicecorr_setup_set_text(slicecorr_setup* setup, const char* name,
                                                        const char* value);
/** The same for a number. NaN takes the setting back. */
SLICECORR_API slicecorr_status slicecorr_setup_set_number(slicecorr_setup* setup, const char* name,
                                                          double value);
/** The same for a list of numbers; `count` 0 takes it back. */
SLICECORR_API slicecorr_status slicecorr_setup_set_numbers(slicecorr_setup* setup, const char* name,
                                                           const double* values, size_t count);
/** As slicecorr_error_text(), for the last call that took this setup first. "" for NULL. */
SLICECORR_API const char* slicecorr_setup_error_text(const slicecorr_setup* setup);

/* ---- Jobs: how a long call runs and whom it tells --------------------------------------------- */

typedef struct slicecorr_job slicecorr_job;

/** Progress of a stage ("read", "correct", "predict", "write", others may come): the fraction done,
 *  from 0 to 1, never falling until 1; a stage may come again. Other than 0 cancels the job.
 *  Called from threads of the library, never from two at once, not even for different jobs: be
 *  quick, and do not wait for another thread that calls the library. May call the library. */
typedef int (*slicecorr_progress)(void* user, const char* stage, double fraction);
/** A remark that a user should see, one line. Called as slicecorr_progress. */
typedef void (*slicecorr_notice)(void* user, const char* text);

/** A job of all cores that tells nobody; NULL when there is no memory. Functions that take a job
 *  take NULL for such a one. */
SLICECORR_API slicecorr_job* slicecorr_job_new(void);
SLICECORR_API void slicecorr_job_free(slicecorr_job* job);
/** Number of threads, 1 to 4096; 0 is all cores. */
SLICECORR_API slicecorr_status slicecorr_job_set_threads(slicecorr_job* job, int threads);
/** NULL to tell nobody. `user` is passed on. */
SLICECORR_API slicecorr_status slicecorr_job_set_progress(slicecorr_job* job,
                                                          slicecorr_progress progress, void* user);
SLICECORR_API slicecorr_status slicecorr_job_set_notice(slicecorr_job* job, slicecorr_notice notice,
                                                        void* user);
/** Folder for scratch files, which appear above 256 MiB of coded slices and have no names: the
 *  folder of the output, or the system's for temporary files, when not set. */
SLICECORR_API slicecorr_status slicecorr_job_set_scratch_folder(slicecorr_job* job,
                                                                const char* folder);
/** Makes the call that runs with this job, and all later ones, end with SLICECORR_CANCELLED, at the
 *  latest after the rows at hand (a few million voxels). A call that has nothing left to do but to
 *  return may still succeed. From any thread, and from signal handlers. Takes NULL. */
SLICECORR_API void slicecorr_job_cancel(slicecorr_job* job);
/** Makes a cancelled job usable again. */
SLICECORR_API slicecorr_status slicecorr_job_reset(slicecorr_job* job);
/** As slicecorr_error_text(), for the last call that ran with this job or changed it. "" for NULL. */
SLICECORR_API const char* slicecorr_job_error_text(const slicecorr_job* job);

/* ---- Stacks ----------------------------------------------------------------------------------- */

typedef struct slicecorr_stack slicecorr_stack;

/** Size and scale of a stack in memory. */
typedef struct slicecorr_grid {
  size_t struct_size; /**< sizeof(slicecorr_grid) */
  int32_t width_px;   /**< columns of a slice, 1..65536, as the printer's display has */
  int32_t height_px;  /**< rows of a slice, 1..65536 */
  int32_t layers;     /**< number of slices, 1..1000000 */
  int32_t reserved;   /**< 0 */
  double pixel_x_um;  /**< width of a pixel on the window, > 0 */
  double pixel_y_um;  /**< height of a pixel on the window, > 0 */
  double layer_um;    /**< height of a layer, 0.1..10000 */
} slicecorr_grid;

/** Opens an archive of any format that slicecorr_list_new("format") lists. Reads what it says, not
 *  its images: these are read by the calls that need them, or by slicecorr_stack_load(). */
SLICECORR_API slicecorr_status slicecorr_stack_open(const char* path, slicecorr_stack** stack);
/** A target in memory, all black. */
SLICECORR_API slicecorr_status slicecorr_stack_create(const slicecorr_grid* grid,
                                                      slicecorr_stack** stack);
SLICECORR_API void slicecorr_stack_free(slicecorr_stack* stack);

/** Sets a slice of a stack in memory: `height_px` rows of `width_px` bytes, `stride` bytes from one
 *  row to the next (negative when the rows lie from the last to the first; `pixels` is row 0).
 *  Keeps them run-length coded; what a slice held before stays in memory, too. Different slices may
 *  be put from several threads at once. */
SLICECORR_API slicecorr_status slicecorr_stack_put(slicecorr_stack* stack, int slice,
                                                   const uint8_t* pixels, ptrdiff_t stride);
/** Writes a slice of a stack in memory to `pixels`, laid out as above. */
SLICECORR_API slicecorr_status slicecorr_stack_get(const slicecorr_stack* stack, int slice,
                                                   uint8_t* pixels, ptrdiff_t stride);
/** Reads all images of an archive into memory, once for all later calls. Does nothing for stacks
 *  that are there already. */
SLICECORR_API slicecorr_status slicecorr_stack_load(slicecorr_stack* stack, slicecorr_job* job);
/** Says what an archive does not say: pixel_x_um, pixel_y_um, layer_um. Where pixel sizes are still
 *  missing, those of the setup's printer count. SLICECORR_BAD_INPUT when it does say it.
 *
 *  Says how the slices of a stack of slicecorr_stack_create() lie, which matters to printers with an
 *  orientation or a flat-field: for_display is 1 (as they come) when the display shows them as they
 *  are, 0 when they show the plate (row 0 at the largest y, column 0 at the smallest x) and the
 *  printer's orientation turns them. portrait, mirror_x, mirror_y (0 or 1) say how the plate lies in
 *  slices for a display: x of the plate up and y to the left; then left and right, top and bottom
 *  swapped. */
SLICECORR_API slicecorr_status slicecorr_stack_set_number(slicecorr_stack* stack, const char* name,
                                                          double value);

/** Doses that are wanted of the features of `target`, in critical doses: a byte v of `doses` stands
 *  for 1 + (greatest - 1) v / 255. `doses` is in memory and has the size and number of slices of
 *  `target`; it may be freed afterwards. `side` says how doses are met that change too steeply
 *  along z: nearest, at-least or at-most; NULL: nearest. `doses` NULL: none are wanted. Counted by
 *  slicecorr_correct(), slicecorr_correct_in_memory() and, as "regions" of the figures' JSON, by
 *  slicecorr_verify(); in both modes, and under UV light (docs/graded-dose.md). */
SLICECORR_API slicecorr_status slicecorr_stack_set_doses(slicecorr_stack* target,
                                                         const slicecorr_stack* doses,
                                                         double greatest, const char* side);

/** What a stack says about itself; 0 where it does not.
 *
 *  width_px, height_px, layers, pixel_x_um, pixel_y_um, layer_um
 *  target_layers         layers of the part; layers also counts slices added after its end
 *  part_volume_mm3
 *  exposure_s, bottom_exposure_s, bottom_layers, fade_layers   light-on times
 *  speed_mm_h            of a corrected continuous stack
 *  uv_mw_cm2, dead_zone_um
 *  light_s               in which slices are shown
 *  print_time_s          of the whole print, with lifts; 0 where these are not known
 *  own_print_time_s      that the archive says itself
 *  for_display, portrait, mirror_x, mirror_y   how its slices lie, see above
 *  corrected             1 for a corrected stack, else 0
 *  parameters_checked    1 when the archive has a checksum of its parameters; where it is wrong,
 *                        opening fails
 *  in_memory             1 when its images are in memory, else 0 */
SLICECORR_API slicecorr_status slicecorr_stack_number(const slicecorr_stack* stack,
                                                      const char* name, double* value);
/** A list of numbers: layer_exposure_s (light-on time of each layer), light_share (share of full
 *  light of each layer), layer_heights_um (height of each layer, where they differ), uv_slice_mw_cm2
 *  (UV intensity of each slice), uv_of_pixel (256: UV pixel value to each pixel value of a patterned
 *  stack). Writes at most `capacity` of them and sets `count` to how many there are; 0 when it does
 *  not say. */
SLICECORR_API slicecorr_status slicecorr_stack_numbers(const slicecorr_stack* stack,
                                                       const char* name, double* values,
                                                       size_t capacity, size_t* count);
/** path, format, kind (target, corrected, recorded, foreign), program, mode; printer and resin of a
 *  corrected or recorded stack; printer_profile, material_profile, print_profile as a slicer named
 *  them. "" where it does not say; NULL for other names and for NULL. */
SLICECORR_API const char* slicecorr_stack_text(const slicecorr_stack* stack, const char* name);

/* ---- Figures ---------------------------------------------------------------------------------- */

typedef struct slicecorr_figures slicecorr_figures;

/** The main figures of a stack. What the words mean: docs/correction.md. Height errors are NaN when no edge was
 *  designed. */
typedef struct slicecorr_summary {
  size_t struct_size; /**< in: sizeof(slicecorr_summary) */
  uint64_t target_voxels, printed_voxels;
  uint64_t cure_through_voxels; /**< printed though not designed */
  uint64_t undercure_voxels;    /**< designed but not printed */
  uint64_t lost_features, merged_features;
  double iou;                      /**< overlap of print and design, 0..1 */
  double mean_abs_height_error_um; /**< at designed edges */
  double p95_abs_height_error_um, max_abs_height_error_um;
} slicecorr_summary;

/** Fills what the caller's struct has room for, by its struct_size. SLICECORR_BAD_CALL for figures of
 *  a tomographic job. */
SLICECORR_API slicecorr_status slicecorr_figures_summary(const slicecorr_figures* figures,
                                                         slicecorr_summary* summary);
/** One figure by its place in the JSON text: "iou", "height_error_um.max_abs". NaN when there is
 *  nothing that it could be measured at. */
SLICECORR_API slicecorr_status slicecorr_figures_number(const slicecorr_figures* figures,
                                                        const char* name, double* value);
/** SLICECORR_MISSED when the figure is above `most`. */
SLICECORR_API slicecorr_status slicecorr_figures_require(const slicecorr_figures* figures,
                                                         const char* name, double most);
/** All figures, as `slicecorr verify --json` writes them, or `slicecorr tomo verify --json`. NULL for
 *  NULL. */
SLICECORR_API const char* slicecorr_figures_json(const slicecorr_figures* figures);
SLICECORR_API void slicecorr_figures_free(slicecorr_figures* figures);

/* ---- The work --------------------------------------------------------------------------------- */

/** Whether `setup` can print `target` at all: size, scale, stage, light. Looks at no image, unless
 * the printer has a flat-field (then at the places that are lit), suction is judged, or something is
 * left alone. */
SLICECORR_API slicecorr_status slicecorr_check(const slicecorr_stack* target,
                                               const slicecorr_setup* setup, slicecorr_job* job);

/** Corrects `target` and writes the archive `path`, in the format that its ending names. When target
 *  is another program's archive of the same format, all else that is in it is kept. `path` may be
 *  its own: it is then corrected in place. The archive appears whole or not at all, and replaces
 *  what was there in one step. A corrected stack is not corrected again: SLICECORR_BAD_INPUT.
 *
 *  `after` and `before`: what the corrected and the uncorrected slices print; NULL when not wanted,
 *  which saves time for `before`. */
SLICECORR_API slicecorr_status slicecorr_correct(const slicecorr_stack* target,
                                                 const slicecorr_setup* setup, const char* path,
                                                 slicecorr_job* job, slicecorr_figures** after,
                                                 slicecorr_figures** before);

/** The same without a file: `corrected` becomes a stack in memory, of as many slices as the part
 *  needs (more than `target` where light after its end is needed), to be read by
 *  slicecorr_stack_get(). Its pixels equal those of slicecorr_correct(). `after` costs a pass more
 *  here. */
SLICECORR_API slicecorr_status slicecorr_correct_in_memory(const slicecorr_stack* target,
                                                           const slicecorr_setup* setup,
                                                           slicecorr_job* job,
                                                           slicecorr_stack** corrected,
                                                           slicecorr_figures** after);

/** Gives or takes one slice; `pixels` are height_px rows of width_px bytes without gaps, black when
 *  a source is asked. Other than 0 cancels the call. Both are called in the calling thread, from the
 *  first slice to the last, first all of the source, then all of the sink. */
typedef int (*slicecorr_slice_source)(void* user, int slice, uint8_t* pixels);
typedef int (*slicecorr_slice_sink)(void* user, int slice, int slices, const uint8_t* pixels);

/** slicecorr_correct_in_memory() for slices that callbacks give and take. */
SLICECORR_API slicecorr_status
slicecorr_correct_slices(const slicecorr_grid* grid, slicecorr_slice_source source,
                         void* source_user, const slicecorr_setup* setup, slicecorr_job* job,
                         slicecorr_slice_sink sink, void* sink_user, slicecorr_figures** after);

/** Predicts what `stack` prints, against `target`. `setup` may be NULL for a corrected stack, which
 *  says how it is printed; what a setup says counts before that. */
SLICECORR_API slicecorr_status slicecorr_verify(const slicecorr_stack* stack,
                                                const slicecorr_stack* target,
                                                const slicecorr_setup* setup, slicecorr_job* job,
                                                slicecorr_figures** figures);

/** Predicts what `target` prints when its slices are shown as they are. */
SLICECORR_API slicecorr_status slicecorr_predict(const slicecorr_stack* target,
                                                 const slicecorr_setup* setup, slicecorr_job* job,
                                                 slicecorr_figures** figures);

/** Measures a scan of a print: a mesh, points, or a volume (docs/scan.md), in any pose. `stack` is what was printed; what
 *  it is predicted to print says how the scan lies, with the printer and resin of `setup` where these are set (NULL: as
 *  it was corrected). Where the setup names the mesh that was sliced (design), the scan is measured against that, too.
 *  `figures`: those of `slicecorr scan compare --json` ("deviations.0.mean_abs_um"); they have no summary. A scan of
 *  another part is SLICECORR_BAD_INPUT. */
SLICECORR_API slicecorr_status slicecorr_scan_compare(const char* scan,
                                                      const slicecorr_stack* stack,
                                                      const slicecorr_setup* setup,
                                                      slicecorr_job* job,
                                                      slicecorr_figures** figures);

/** Finds what of printer and resin explains scans of prints of one stack (docs/scan.md): `count` paths of meshes, points or
 *  volumes. `stack` is the archive that was printed; `setup` names the printer and resin that were believed (printer or
 *  printer_toml, resin or resin_toml), and scan_unit and voxel_um where scans have them. `figures`: an object that has no
 *  summary, with "inputs" (each with its change, sd, sd_before, and whether the scans tell it), "rms_before_um" and
 *  "rms_after_um" of the surface as a whole, "unexplained" places, "text" for people, and "resin_toml" and
 *  "printer_toml", the files with what was found. Nothing is written. A scan of another part is SLICECORR_BAD_INPUT. It needs the module
 *  slicecorr-tuning.so, without which it is SLICECORR_DEVICE. */
SLICECORR_API slicecorr_status slicecorr_tune_scans(const char* const* scans, size_t count,
                                                    const slicecorr_stack* stack,
                                                    const slicecorr_setup* setup,
                                                    slicecorr_job* job,
                                                    slicecorr_figures** figures);

/** Finds how fast `target` can be printed with edges within tolerance_um (25 when not set) and a
 *  contrast of gap_contrast (0.05) in gaps, and what limits it; layer by layer the least exposure. The
 *  setup says neither. `figures`: those of `slicecorr plan --json` ("speed_mm_h", "curve.0.contrast");
 *  they have no summary. SLICECORR_INFEASIBLE where nothing prints it so. */
SLICECORR_API slicecorr_status slicecorr_plan(const slicecorr_stack* target,
                                              const slicecorr_setup* setup, slicecorr_job* job,
                                              slicecorr_figures** figures);

/** Writes a stack into another archive, in the format that the ending of `path` names, with all that
 *  both formats can say; what is lost is told as a notice. Archives, and targets in memory. */
SLICECORR_API slicecorr_status slicecorr_convert(const slicecorr_stack* stack, const char* path,
                                                 slicecorr_job* job);

/* ---- Tomographic printing --------------------------------------------------------------------- */

/*  A vial of resin turns before a projector, and the whole part gels at once (docs/tomography.md).
 *  Two operators are all that finding its light needs: A sums a volume along the lines of light, A^T,
 *  its exact transpose, gives the dose of light. A program may call them from an optimiser of its
 *  own, or leave all to slicecorr_tomo_solve().
 *
 *  Frame. z is the axis of rotation, upwards. At angle m of `angles`, th = 2 pi m / angles, a point
 *  (x, y) of the part lies at t = x cos th + y sin th and u = -x sin th + y cos th; light travels
 *  towards +u, and pixel i shows the line t = (i - (pixels - 1) / 2) pixel_mm. th grows when the vial
 *  turns clockwise, seen from above. Light stays in its slice.
 *
 *  Arrays have three axes.
 *    volumes   (slices, voxels, voxels): z, y, x, the lowest slice first. The voxels' middles along
 *              x and y are `voxels` points from -radius_mm to radius_mm; those further than radius_mm
 *              from the axis count for nothing, and are 0 in what is written.
 *    light     (slices, angles, pixels): z, angle, t. So slice k of a volume and slice k of light
 *              belong together, whatever the others are.
 *    parts     volumes of bytes: 255 is part, 0 empty, between them neither, which is not judged.
 *    inserts   volumes of bytes: above 0 is opaque and turns with the part; NULL for none.
 *    frames    (frames, height_px, width_px): the projector's images as seen from it, in bytes.
 *
 *  Units. Light of benches of a setup is in mW/cm² at the plane of the axis, without vial. A^T of it,
 *  times the property turn_mj_cm3, is the dose of one turn in mJ/cm³. Benches of plain numbers say
 *  nothing of time or resin: A^T of light is the sum over the angles of light times e^(-absorption
 *  times the way through resin). The mean over angles is that over `angles`. */

/** What an array's numbers are. */
enum { SLICECORR_UINT8 = 1, SLICECORR_FLOAT32 = 2, SLICECORR_FLOAT64 = 3 };

/** An array in the caller's memory. Any strides will do, as NumPy has them: negative ones, 0 where
 *  the array is only read, numbers that are not aligned. Arrays that are written share no memory with
 *  others of the call; a call that fails may have written some of them. */
typedef struct slicecorr_array {
  size_t struct_size;   /**< sizeof(slicecorr_array) */
  int32_t type;         /**< SLICECORR_UINT8, SLICECORR_FLOAT32, SLICECORR_FLOAT64 */
  int32_t reserved;     /**< 0 */
  void* data;           /**< number 0, 0, 0 */
  size_t shape[3];      /**< of the axes, the slowest first */
  ptrdiff_t strides[3]; /**< bytes from one number to the next along each axis */
} slicecorr_array;

/** Voxels, angles and pixels in plain numbers. */
typedef struct slicecorr_tomo_grid {
  size_t struct_size;       /**< sizeof(slicecorr_tomo_grid) */
  int32_t voxels;           /**< along x and along y, 2..16384 */
  int32_t slices;           /**< along z, 1..1000000 */
  int32_t angles;           /**< of a turn, 3..100000 */
  int32_t pixels;           /**< along t, 2..65536; 0: as many as voxels */
  double radius_mm;         /**< of the resin, > 0 */
  double pixel_mm;          /**< from one pixel to the next, > 0; 0: as voxels */
  double absorption_per_cm; /**< of the resin, base e, >= 0 */
} slicecorr_tomo_grid;

/** The pair of operators with its grid: never changes, for any number of threads at once. */
typedef struct slicecorr_tomo_bench slicecorr_tomo_bench;

/** A bench of plain numbers: parallel light in a bath of the resin's index. */
SLICECORR_API slicecorr_status slicecorr_tomo_bench_create(const slicecorr_tomo_grid* grid,
                                                           const slicecorr_array* insert,
                                                           slicecorr_tomo_bench** bench);
/** The bench of a setup's printer, resin, voxel_mm and angles, with so many slices: voxels fill the
 *  resin from the axis to the wall; the vial refracts, reflects and absorbs as its file says. */
SLICECORR_API slicecorr_status slicecorr_tomo_bench_new(const slicecorr_setup* setup, int slices,
                                                        const slicecorr_array* insert,
                                                        slicecorr_tomo_bench** bench);
SLICECORR_API void slicecorr_tomo_bench_free(slicecorr_tomo_bench* bench);

/** voxels, slices, angles, pixels, radius_mm, voxel_mm, pixel_mm, absorption_per_cm
 *  alpha_r               absorption times the resin's radius
 *  and, NaN for benches of plain numbers:
 *  reach_mm              radius up to which light comes from all directions
 *  turn_s                time of a turn
 *  turn_mj_cm3           dose of one turn for each unit of A^T of light in mW/cm²
 *  to_gel_mj_cm3         dose that gels
 *  black_mw_cm2, most_mw_cm2   of the darkest and the brightest grey level */
SLICECORR_API slicecorr_status slicecorr_tomo_bench_number(const slicecorr_tomo_bench* bench,
                                                           const char* name, double* value);

/** light = A volume. Numbers are SLICECORR_FLOAT32 or SLICECORR_FLOAT64, each array as it likes, and
 *  must be finite; what is computed has single precision. The same bytes for any number of threads. */
SLICECORR_API slicecorr_status slicecorr_tomo_forward(const slicecorr_tomo_bench* bench,
                                                      const slicecorr_array* volume,
                                                      const slicecorr_array* light,
                                                      slicecorr_job* job);
/** volume = A^T light; see there. */
SLICECORR_API slicecorr_status slicecorr_tomo_adjoint(const slicecorr_tomo_bench* bench,
                                                      const slicecorr_array* light,
                                                      const slicecorr_array* volume,
                                                      slicecorr_job* job);
/** Light for a part by filtered back projection, with nothing below 0, of which the largest is 1: a
 *  start for optimisers. `window` as the setting; NULL: hamming. Does not see the insert. */
SLICECORR_API slicecorr_status slicecorr_tomo_filtered_start(const slicecorr_tomo_bench* bench,
                                                             const slicecorr_array* part,
                                                             const char* window,
                                                             const slicecorr_array* light,
                                                             slicecorr_job* job);

/** Frames of a turn with the printer, the resin and the part that they are for; a .frames file. It
 *  never changes, for any number of threads at once. */
typedef struct slicecorr_tomo_job slicecorr_tomo_job;

/** Finds the light of a part, as `slicecorr tomo solve --volume` does, with the settings of `setup`.
 *  `part` and `insert` are squares of any size, middled on the axis, with nothing around them; they
 *  have one shape. `figures`: what the frames print; NULL when not wanted. Where void gels with the
 *  part, or some of the part does not, the job is given all the same, and `feasible` of the figures
 *  is 0. SLICECORR_INFEASIBLE with what is in the way where no light prints the part. */
SLICECORR_API slicecorr_status slicecorr_tomo_solve(
    const slicecorr_array* part, const slicecorr_array* insert, const slicecorr_setup* setup,
    slicecorr_job* job, slicecorr_tomo_job** tomo_job, slicecorr_figures** figures);
/** A job of light that the caller found: of each number of `light`, mW/cm² on the bench of `setup`,
 *  with as many angles as light has, the nearest grey level is shown, for `turns` whole turns. */
SLICECORR_API slicecorr_status slicecorr_tomo_job_of_light(const slicecorr_array* part,
                                                           const slicecorr_array* insert,
                                                           const slicecorr_array* light, int turns,
                                                           const slicecorr_setup* setup,
                                                           slicecorr_tomo_job** tomo_job);
SLICECORR_API slicecorr_status slicecorr_tomo_job_open(const char* path, slicecorr_job* job,
                                                       slicecorr_tomo_job** tomo_job);
/** Writes the job as a file: whole or not at all. The same job gives the same bytes. */
SLICECORR_API slicecorr_status slicecorr_tomo_job_write(const slicecorr_tomo_job* tomo_job,
                                                        const char* path, slicecorr_job* job);
SLICECORR_API void slicecorr_tomo_job_free(slicecorr_tomo_job* tomo_job);

/** The properties of its bench, and
 *  turns                 whole turns
 *  print_time_s          their time
 *  width_px, height_px   of a frame
 *  clockwise             1 when the vial turns clockwise, seen from above: frame f is then shown at
 *                        angle f; else 0: frame 0 at angle 0, frame f at angle `angles` - f
 *  insert                1 with an insert, else 0 */
SLICECORR_API slicecorr_status slicecorr_tomo_job_number(const slicecorr_tomo_job* tomo_job,
                                                         const char* name, double* value);
/** Writes frames from `first` on, as many as the array of bytes has room for on its first axis. */
SLICECORR_API slicecorr_status slicecorr_tomo_job_frames(const slicecorr_tomo_job* tomo_job,
                                                         int first, const slicecorr_array* frames,
                                                         slicecorr_job* job);
/** Writes what the frames show, mW/cm² on the job's bench. */
SLICECORR_API slicecorr_status slicecorr_tomo_job_light(const slicecorr_tomo_job* tomo_job,
                                                        const slicecorr_array* light,
                                                        slicecorr_job* job);
/** Writes the part that the frames are for, in bytes, on the job's bench. */
SLICECORR_API slicecorr_status slicecorr_tomo_job_part(const slicecorr_tomo_job* tomo_job,
                                                       const slicecorr_array* part,
                                                       slicecorr_job* job);
/** Writes the dose of the whole print, mJ/cm³, by a sum over all angles in double precision that
 *  shares nothing with A^T. */
SLICECORR_API slicecorr_status slicecorr_tomo_job_dose(const slicecorr_tomo_job* tomo_job,
                                                       const slicecorr_array* dose,
                                                       slicecorr_job* job);
/** What the frames print by these doses, as `slicecorr tomo verify` judges it: against `part`, a
 *  square of any size, or the job's own for NULL. */
SLICECORR_API slicecorr_status slicecorr_tomo_verify(const slicecorr_tomo_job* tomo_job,
                                                     const slicecorr_array* part,
                                                     slicecorr_job* job,
                                                     slicecorr_figures** figures);

#ifdef __cplusplus
}
#endif

#endif /* SLICECORR_H */
