/* test_materials.c - the presets: complete, sound for the solver, and within what was measured. */
#include "test.h"

#include "materials.h"
#include "schema.h"

#define FABRICS "../shared/data/fabrics/measured.csv"

static void test_materials__at_least_eight_presets_with_their_own_names_and_sources(void **state)
{
    (void)state;
    size_t n;
    const struct material_preset *preset = materials_all(&n);
    assert_true(n >= 8);
    for (size_t i = 0; i < n; i++) {
        assert_ptr_equal(materials_find(preset[i].name), &preset[i]); /* the first of its name */
        assert_true(strspn(preset[i].name, "abcdefghijklmnopqrstuvwxyz-") == strlen(preset[i].name));
        assert_true(strlen(preset[i].source) > 40);
        assert_true(strlen(preset[i].summary) > 10);
    }
    assert_null(materials_find("tweed"));
    assert_null(materials_find(""));
}

/* The solver's own check, on the smallest cloth of each fabric. */
static void test_materials__the_solver_takes_every_preset(void **state)
{
    (void)state;
    static const double positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, pattern[] = {0, 0, 1, 0, 0, 1};
    static const uint32_t triangle[] = {0, 1, 2}, pin[] = {0};
    size_t n;
    const struct material_preset *preset = materials_all(&n);
    for (size_t i = 0; i < n; i++) {
        drape_error error = {0};
        drape_scene_desc desc = drape_scene_desc_default();
        desc.vertices = 3;
        desc.triangles = desc.pins = desc.materials = 1;
        desc.positions = positions;
        desc.pattern = pattern;
        desc.triangle = triangle;
        desc.pin = pin;
        desc.material = &preset[i].material;
        if (drape_scene_check(&desc, &error) < 0)
            fail_msg("%s: %s", preset[i].name, error.message);
    }
}

/* A loose net for slips of a power of ten: cloth of garments weighs 20 to 1000 g/m2, its KES bending
 * rigidity is 0.005 to 2 gf cm^2/cm, its shear 0.1 to 5 gf/(cm deg). The paper's cloth is no real one. */
static void test_materials__numbers_are_of_the_size_of_garment_cloth(void **state)
{
    (void)state;
    const double bend = 9.80665e-5, shear = 56.19;
    size_t n;
    const struct material_preset *preset = materials_all(&n);
    for (size_t i = 0; i < n; i++) {
        const drape_material *m = &preset[i].material;
        if (strcmp(preset[i].name, "paper-test") == 0)
            continue;
        assert_true(m->density >= 0.02 && m->density <= 1);
        assert_true(m->bend_weft >= 0.005 * bend && m->bend_warp <= 2 * bend);
        assert_true(m->bend_twist <= m->bend_warp && m->bend_twist <= m->bend_weft);
        assert_true(m->stretch_shear >= 0.1 * shear && m->stretch_shear <= 5 * shear);
        assert_true(m->stretch_weft > m->stretch_shear && m->stretch_warp >= m->stretch_weft);
        assert_true(m->stretch_weft >= 100 && m->stretch_warp <= 5e4);
    }
}

static void test_materials__test_cloth_of_the_paper_is_the_papers(void **state)
{
    (void)state;
    const drape_material *m = &materials_find("paper-test")->material;
    assert_close(m->density, 0.1, 0);
    assert_close(m->stretch_weft, 10, 0);
    assert_close(m->stretch_warp, 10, 0);
    assert_close(m->stretch_shear, 5, 0); /* isotropic at Poisson ratio 0 */
    assert_close(m->poisson, 0, 0);
}

/* One field of the row that begins with `name`; NAN when the table leaves it empty. */
static double measured(FILE *file, const char *name, int field)
{
    char line[512];
    rewind(file);
    while (fgets(line, sizeof line, file)) {
        char *at = line, *cell;
        if (strncmp(line, name, strlen(name)) != 0 || line[strlen(name)] != ',')
            continue;
        for (int i = 0; (cell = strsep(&at, ",\n")); i++)
            if (i == field)
                return *cell ? strtod(cell, NULL) : NAN;
    }
    return NAN;
}

static void test_materials__measured_numbers_are_the_measured_ones(void **state)
{
    (void)state;
    enum { WEIGHT = 1, BEND = 4, POISSON = 7 };
    static const struct {
        const char *preset, *row;
        int field;
    } CASE[] = {{"cotton-poplin", "cotton (Penava)", WEIGHT},
                {"cotton-poplin", "cotton (Penava)", POISSON},
                {"cotton-poplin", "cotton broad (A)", BEND},
                {"cotton-twill", "PES/cotton 50/50 twill 3/1", WEIGHT},
                {"wool-tropical", "wool tropical (B)", BEND},
                {"wool-tropical", "wool/lycra (Penava)", WEIGHT},
                {"wool-suiting", "wool (Penava)", WEIGHT},
                {"wool-suiting", "wool (Penava)", POISSON},
                {"polyester-faille", "polyester faille (F)", BEND},
                {"polyester-plain", "polyester (Penava)", WEIGHT},
                {"polyester-plain", "polyester (Penava)", POISSON}};
    FILE *file = fopen(FABRICS, "r");
    if (!file) {
        print_message("SKIP: %s is not there\n", FABRICS);
        skip();
    }
    for (size_t i = 0; i < sizeof CASE / sizeof *CASE; i++) {
        const drape_material *m = &materials_find(CASE[i].preset)->material;
        double there = measured(file, CASE[i].row, CASE[i].field);
        double here = CASE[i].field == WEIGHT ? 1e3 * m->density
                      : CASE[i].field == BEND ? m->bend_weft
                                              : m->poisson;
        assert_close(here, there, 1e-3);
    }
    fclose(file);
}

static void test_materials__json_lists_every_preset(void **state)
{
    (void)state;
    size_t n, i;
    const struct material_preset *preset = materials_all(&n);
    json_t *json = schema_materials_json(), *entry;
    assert_int_equal(json_array_size(json_object_get(json, "materials")), n);
    json_array_foreach(json_object_get(json, "materials"), i, entry)
    {
        assert_string_equal(json_string_value(json_object_get(entry, "name")), preset[i].name);
        assert_string_equal(json_string_value(json_object_get(entry, "source")), preset[i].source);
        assert_close(json_number_value(json_object_get(json_object_get(entry, "bend"), "twist")),
                     preset[i].material.bend_twist, 0);
    }
    json_decref(json);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_materials__at_least_eight_presets_with_their_own_names_and_sources),
        cmocka_unit_test(test_materials__the_solver_takes_every_preset),
        cmocka_unit_test(test_materials__numbers_are_of_the_size_of_garment_cloth),
        cmocka_unit_test(test_materials__test_cloth_of_the_paper_is_the_papers),
        cmocka_unit_test(test_materials__measured_numbers_are_the_measured_ones),
        cmocka_unit_test(test_materials__json_lists_every_preset),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
