// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <array>

#include "process/keys/kind_keys.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

namespace {

using enum KeyType;

constexpr KeysOf kCure{"cure"}, kInhibition{"inhibition"}, kBleaching{"bleaching"},
    kChemistry{"chemistry"}, kShrinkage{"shrinkage"}, kFirstLayers{"first_layers"},
    kComposition{"composition"};

constexpr std::array kResinKeys = std::to_array<KeyRule>({
    kRoot("name", text, "stable name, that of the file"),
    kRoot("version", whole, between(1, 1e9), "rises with every change that is saved"),
    kRoot("maker", text, "who makes it"),
    kRoot("product", text, "the maker's name for it"),
    kRoot("aliases", texts, "other names that people know it by"),
    kRoot("tags", texts,
          "words that say its kind, as its maker does, such as \"tough\" or \"abs-like\""),
    kRoot("chemistry", text, "such as acrylate, methacrylate, epoxy; or the table below"),
    kRoot("colour", text, "a word, or #RRGGBB"),
    kRoot("notes", text, "anything else"),
    kCure("model", choice, "jacobs|kinetic|gel-time", "working curve; jacobs without it"),
    kCure("gel_a_mj_cm2", number, from(0, 1e9),
          "gel-time: A of the time to gel A/i + B/sqrt(i), the dose that inhibitors take"),
    kCure("gel_b_sqrt_mw_cm2_s", number, from(0, 1e9), "gel-time: B of it, sqrt(mW/cm²)·s"),
    kCure("m", number, up_to(2), "exponent of intensity; 1 without it, and for jacobs"),
    kCure("wavelength_nm", number, between(100, 2000), "of the curing light"),
    kCure("absorbance_height_um", number, up_to(1e7),
          "over which the curing light falls to 1/e or 1/10; required unless absorption_per_cm is "
          "given"),
    kCure("absorbance_base", base, "which of the two; it goes with absorbance_height_um"),
    kCure("gel_dose_mj_cm3", number, up_to(1e9), "measured gel dose, volumetric"),
    kCure("gel_dose_mj_cm2", number, up_to(1e9), "... or areal"),
    kCure(
        "dose_factor", number, up_to(1e3),
        "dose aimed at over gel dose, or time aimed at over time to gel; 5 without it (1 for critical_dose_prime)"),
    kCure("critical_dose_mj_cm3", number, up_to(1e9),
          "dose aimed at in place of gel dose times factor, volumetric"),
    kCure("critical_dose_mj_cm2", number, up_to(1e9), "... or areal"),
    kCure("critical_dose_prime", number, up_to(1e9),
          "D'c of a kinetic fit, (mW/cm²)^m·s; the gel dose when dose_factor stands beside it"),
    kCure("unit", choice, "mW/cm2|of the brightest level",
          "in what its doses count light; mW/cm2 without it. Of the brightest level: the printer's "
          "own (resinctl calibrate), with model = \"jacobs\" and critical_dose_s"),
    kCure(
        "critical_dose_s", number, up_to(1e9),
        "dose aimed at in seconds of the brightest level's light, which gel a surface; with such a "
        "unit alone"),
    kCure("display", text,
          "name of the printer whose full light these are; another one is told of"),
    also_at_top(kCure(
        "absorption_per_cm", number, up_to(1e6),
        "absorption of the curing light, base e, in place of absorbance_height_um or beside it")),
    also_at_top(kCure("active_absorption_per_cm", number, up_to(1e6),
                      "the part of it that cures; all of it without it")),
    also_at_top(kCure("n", number, from(1, 3),
                      "refractive index for the curing light; tomographic printing needs it")),
    also_at_top(
        kCure("inhibition_dose_mj_cm3", number, from(0, 1e9),
              "dose that inhibitors take before the gel dose begins to count, in tomographic "
              "printing; 0 without it")),
    also_at_top(kCure("inhibition_resupply_mj_cm3_s", number, from(0, 1e9),
                      "how much of that comes back in a second; 0 without it")),
    also_at_top(kCure(
        "dose_diffusion_m2_s", number, from(0, 1e-6),
        "how fast dose spreads in the resin, in tomographic printing and where resin flows; 0 without "
        "it: not at all")),
    also_at_top(
        kCure("scatter_um2_per_um", number, from(0, 1e3),
              "by how much the variance of light along each axis grows with depth; 0 without it")),
    also_at_top(kCure(
        "extinction_per_cm", number, up_to(1e6),
        "of a turbid resin: what a beam loses on its way, base e, in tomographic printing; the "
        "absorption is what of it does not scatter")),
    also_at_top(kCure("albedo", number, from(0, 0.9999), "share of the extinction that scatters")),
    also_at_top(kCure("anisotropy", number, from(0.9, 0.995),
                      "mean cosine of the angle of scattering (Henyey and Greenstein's g)")),
    also_at_top(kCure("viscosity_pa_s", number, up_to(kMostViscosity),
                      "dynamic viscosity of the liquid resin; what tells of resin flow needs it")),
    also_at_top(kCure(
        "inhibitor_life_s", number, from(0, kMostLifeS),
        "how long inhibitor that UV light has made stays, where resin flows; without it until "
        "blue light uses it up")),
    required(
        kInhibition("beta", number, up_to(1e6), "UV counts so many times against blue, areal")),
    required(kInhibition("absorbance_height_um", number, up_to(1e7),
                         "of the UV light; less than that of the curing light")),
    required(kInhibition("absorbance_base", base, "1/e or 1/10")),
    kInhibition("wavelength_nm", number, between(100, 2000), "of the UV light"),
    kInhibition("m", number, up_to(2), "exponent under UV; that of [cure] without it"),
    kInhibition("critical_dose_prime", number, up_to(1e9),
                "gel dose D'c that belongs to this m; that of [cure] without it"),
    kCure(
        "green_strength", number, from(1, 10),
        "layer by layer: gel doses of its own exposure at a layer's far edge with which it holds when "
        "the platform lifts; 1.2 without it"),
    required(kBleaching("absorbance_height_um", number, up_to(1e7),
                        "that of bleached resin, for the curing light; at least that of [cure]")),
    required(kBleaching("absorbance_base", base, "1/e or 1/10")),
    required(
        kBleaching("dose_mj_cm2", number, up_to(1e9), "of light that takes what bleaches to 1/e")),
    kChemistry("family", text, "such as acrylate, methacrylate, epoxy"),
    required(kChemistry("groups_mol_l", number, up_to(kMostConcentration),
                        "end groups that can be bonded, before light")),
    required(kChemistry("initiator_mol_l", number, up_to(kMostConcentration),
                        "initiator, before light")),
    required(kChemistry("oxygen_mol_l", number, from(0, kMostConcentration),
                        "dissolved oxygen, before light")),
    kChemistry("inhibitor_mol_l", number, from(0, kMostConcentration),
               "added inhibitor, before light; 0 without it"),
    kChemistry("wavelength_nm", number, from(100, 2000),
               "of the light that the absorptivity holds for; that of [cure] without it"),
    required(
        kChemistry("absorptivity_l_mol_cm", number, up_to(kMostAbsorptivity), "of the initiator")),
    required(kChemistry("absorptivity_base", base, "10, as spectrometers have it, or e")),
    kChemistry("other_absorption_per_cm", number, from(0, 1e6),
               "of all that is not initiator, base e; 0 without it"),
    required(kChemistry("quantum_yield", number, up_to(1),
                        "breaks of initiator per photon that it takes")),
    required(kChemistry("initiation_l_mol_s", number, up_to(kMostRate),
                        "kI, of initiator radicals and end groups")),
    required(kChemistry("propagation_l_mol_s", number, up_to(kMostRate),
                        "kp, of chains and end groups")),
    required(kChemistry("termination_l_mol_s", number, up_to(kMostRate), "kt, of two chains")),
    required(kChemistry("termination_counts", choice, "pairs|radicals",
                        "what kt counts: chains vanish at 2 kt R² (pairs) or at kt R² (radicals)")),
    kChemistry("oxygen_l_mol_s", number, from(0, kMostRate),
               "ktO, of chains and oxygen; needed where there is oxygen"),
    kChemistry("initiator_oxygen_l_mol_s", number, from(0, kMostRate),
               "kIO, of initiator radicals and oxygen; 0 without it"),
    kChemistry("inhibitor_l_mol_s", number, from(0, kMostRate),
               "ktQ, of chains and inhibitor; needed where there is inhibitor"),
    required(kChemistry("gel_conversion", number, up_to(1),
                        "share of the end groups used up at which the resin gels; below 1")),
    kChemistry("temperature_k", number, up_to(1000), "298.15 without it"),
    kChemistry(
        "viscosity_pa_s", number, up_to(kMostViscosity),
        "of the liquid resin, for diffusivities from radii; the viscosity_pa_s of the resin without it"),
    kChemistry("initiator_radius_angstrom", number, up_to(kMostRadius),
               "of a molecule of initiator, for its diffusivity by Stokes and Einstein"),
    kChemistry("initiator_diffusion_um2_s", number, from(0, kMostDiffusivity),
               "its diffusivity, in place of the radius"),
    kChemistry("radical_radius_angstrom", number, up_to(kMostRadius),
               "of a molecule of initiator radicals, for its diffusivity by Stokes and Einstein"),
    kChemistry("radical_diffusion_um2_s", number, from(0, kMostDiffusivity),
               "its diffusivity, in place of the radius"),
    kChemistry(
        "oxygen_radius_angstrom", number, up_to(kMostRadius),
        "of a molecule of oxygen, for its diffusivity by Stokes and Einstein; 2.16 without it"),
    kChemistry("oxygen_diffusion_um2_s", number, from(0, kMostDiffusivity),
               "its diffusivity, in place of the radius"),
    kChemistry("inhibitor_radius_angstrom", number, up_to(kMostRadius),
               "of a molecule of inhibitor, for its diffusivity by Stokes and Einstein"),
    kChemistry("inhibitor_diffusion_um2_s", number, from(0, kMostDiffusivity),
               "its diffusivity, in place of the radius"),
    kShrinkage("plane", number, from(Shrinkage::kLeast, Shrinkage::kMost),
               "by how much parts get shorter along x and y, per cent; 0 without it"),
    kShrinkage("z", number, from(Shrinkage::kLeast, Shrinkage::kMost), "the same along z"),
    kFirstLayers("growth_um", number, from(0, Shrinkage::kMostGrowthUm),
                 "by how much walls stand out at the platform (elephant's foot); 0 without it"),
    kFirstLayers("height_um", number, up_to(Shrinkage::kMostHeightUm),
                 "up to where that falls to 0, linearly; 500 without it"),
    kProvenance(
        "*", notes,
        "where the figures come from; `measurements` lists CSV files beside the resin file"),
    kComposition("*", parts, from(0, 100), "component and its share, wt%"),
});

}  // namespace

std::span<const KeyRule> resin_keys() { return kResinKeys; }

}  // namespace slicecorr::detail
