/* materials.c - named fabrics in SI units, each with where its numbers come from.
 *
 * Few numbers of real cloth are published together, so each preset says which of its own were measured
 * and which are only of the usual size for that kind of cloth. Conversions from the units of the KES
 * instruments: bending 1 gf cm^2/cm = 9.80665e-5 N m; shear 1 gf/(cm deg) = 56.19 N/m per radian, which
 * is the modulus on 2 E_uv; tensile load 1 gf/cm = 0.980665 N/m. Cloth weights: 1 oz/yd^2 = 33.906 g/m^2,
 * 1 momme = 4.340 g/m^2.
 *
 * Tension: the KES tensile test ends at 490 N/m, where woven cloth has stretched by some percent, so the
 * secant is of the order of 10^4 N/m; at the few N/m of a hanging garment the crimp of the yarns still
 * gives way and the tangent is several times smaller. A drape does not depend on it as long as the cloth
 * stretches by much less than it bends. */
#include "materials.h"

#include <string.h>

/* Abbreviations of the sources named below, spelled out in full in each text that uses them. */
#define M15  "Matsudaira, Masuda, Wada, Yokura, J. Textile Eng. 61(6), 69-73 (2015), direction not stated"
#define P14  "Penava et al. (2014)"
#define VT18 "\"Analysis of a fabric drape profile\", Fibres and Textiles 1/2018"
#define KES                                                                                                  \
    "of the usual size for this kind of cloth in tests after Kawabata (The Standardization and Analysis of " \
    "Hand "                                                                                                  \
    "Evaluation, 1980), not a measurement of one cloth"

/* No preset has a strain-stress curve, and none a friction of its own, so the last four of each are empty. */
static const struct material_preset PRESET[] = {
    {"cotton-poplin",
     "shirting, plain weave, 150 g/m2",
     "density and Poisson ratio of a cotton: " P14 "; bending of a cotton broadcloth: " M15
     "; stretch and shear " KES,
     {0.1503, 2000, 3000, 45, 0.243, 1.157e-5, 1.157e-5, 0.579e-5, {0}, {0}, {0}, 0, 0, 0}},
    {"cotton-twill",
     "trouser weight, twill 3/1, 249 g/m2",
     "density of a polyester/cotton 50/50 twill 3/1: " VT18 "; the rest " KES,
     {0.2489, 2500, 4000, 60, 0.2, 2.0e-5, 3.0e-5, 1.25e-5, {0}, {0}, {0}, 0, 0, 0}},
    {"denim",
     "cotton twill of 12 oz/yd2, 407 g/m2",
     "density is the nominal weight; the rest " KES,
     {0.407, 4000, 6000, 120, 0.2, 5.0e-5, 9.0e-5, 3.5e-5, {0}, {0}, {0}, 0, 0, 0}},
    {"linen",
     "plain weave, 170 g/m2",
     "density is the nominal weight; the rest " KES,
     {0.170, 3000, 3500, 35, 0.2, 1.8e-5, 2.2e-5, 1.0e-5, {0}, {0}, {0}, 0, 0, 0}},
    {"wool-tropical",
     "light suiting, plain weave, 178 g/m2",
     "bending of a wool tropical: " M15 "; density of a wool/lycra cloth: " P14 "; the rest " KES,
     {0.1782, 1200, 1800, 35, 0.2, 6.57e-6, 6.57e-6, 3.29e-6, {0}, {0}, {0}, 0, 0, 0}},
    {"wool-suiting",
     "worsted suiting, 235 g/m2",
     "density and Poisson ratio of a wool cloth: " P14 "; the rest " KES,
     {0.2348, 1200, 1800, 40, 0.277, 9.0e-6, 1.2e-5, 5.3e-6, {0}, {0}, {0}, 0, 0, 0}},
    {"silk-charmeuse",
     "satin of 16 momme, 69 g/m2",
     "density is the nominal weight; the rest " KES,
     {0.0694, 1500, 2500, 15, 0.2, 1.2e-6, 2.0e-6, 0.8e-6, {0}, {0}, {0}, 0, 0, 0}},
    {"polyester-faille",
     "light dress cloth with a fine rib, 110 g/m2",
     "bending of a polyester faille: " M15 "; density is of the usual size; the rest " KES,
     {0.110, 1500, 2500, 18, 0.2, 1.863e-6, 1.863e-6, 0.932e-6, {0}, {0}, {0}, 0, 0, 0}},
    {"polyester-plain",
     "plain weave, 165 g/m2",
     "density and Poisson ratio of a polyester cloth: " P14 "; the rest " KES,
     {0.1646, 2000, 3000, 30, 0.381, 5.0e-6, 7.0e-6, 3.0e-6, {0}, {0}, {0}, 0, 0, 0}},
    {"cotton-jersey",
     "single jersey knit, 160 g/m2",
     "density is the nominal weight; the rest " KES
     "; a knit stretches an order of magnitude more than a weave",
     {0.160, 150, 300, 40, 0.2, 2.0e-6, 4.0e-6, 1.5e-6, {0}, {0}, {0}, 0, 0, 0}},
    {"paper-test",
     "the test cloth of the stop-and-go paper, 100 g/m2 and 10 N/m",
     "density and stretch: Volino and Magnenat-Thalmann, Stop-and-go cloth draping, The Visual Computer "
     "(2007); "
     "isotropic with Poisson ratio 0, and hardly any bending (1e-6 N m), which is our choice: no real cloth "
     "stretches as easily",
     {0.1, 10, 10, 5, 0, 1.0e-6, 1.0e-6, 0.5e-6, {0}, {0}, {0}, 0, 0, 0}},
};

const struct material_preset *materials_all(size_t *ret_count)
{
    *ret_count = sizeof PRESET / sizeof *PRESET;
    return PRESET;
}

const struct material_preset *materials_find(const char *name)
{
    for (size_t i = 0; i < sizeof PRESET / sizeof *PRESET; i++)
        if (strcmp(name, PRESET[i].name) == 0)
            return &PRESET[i];
    return NULL;
}
