/* Corrects an archive: correct IN OUT PRINTER RESIN SPEED_MM_H. IN and OUT may be the same file. */
#include <slicecorr.h>
#include <stdio.h>

static int show(void* out, const char* stage, double fraction) {
  return fprintf(out, "%s %.0f %%\n", stage, 100 * fraction) < 0; /* anything but 0 cancels */
}

int main(int argc, char** argv) {
  if (argc != 6) return SLICECORR_BAD_INPUT;
  slicecorr_setup* setup = slicecorr_setup_new();
  slicecorr_job* job = slicecorr_job_new();
  slicecorr_stack* stack = NULL;
  slicecorr_figures *after = NULL, *before = NULL;
  double a = 0, b = 0;
  slicecorr_status status = slicecorr_stack_open(argv[1], &stack);
  if (!status) status = slicecorr_setup_set_text(setup, "printer", argv[3]);
  if (!status) status = slicecorr_setup_set_text(setup, "resin", argv[4]);
  if (!status) status = slicecorr_setup_set_text(setup, "speed_mm_h", argv[5]);
  if (!status) status = slicecorr_job_set_progress(job, show, stderr);
  if (!status) status = slicecorr_correct(stack, setup, argv[2], job, &after, &before);
  if (!status) status = slicecorr_figures_number(after, "height_error_um.mean_abs", &a);
  if (!status) status = slicecorr_figures_number(before, "height_error_um.mean_abs", &b);
  if (status) fprintf(stderr, "correct: %s\n", slicecorr_error_text());
  if (!status) printf("mean height error %.2f um, without correction %.2f um\n", a, b);
  slicecorr_figures_free(before);
  slicecorr_figures_free(after);
  slicecorr_stack_free(stack);
  slicecorr_job_free(job);
  slicecorr_setup_free(setup);
  return status;
}
