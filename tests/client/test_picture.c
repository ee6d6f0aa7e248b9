/* test_picture.c - a job and a result become a PNG that shows the cloth in front of the body. */
#include "test.h"

#include <png.h>
#include <unistd.h>

#include "jobfile.h"
#include "picture.h"

static const char job[] =
    "{\"cloth\": {\"mesh\": {\"positions\": [-0.5,0,0.6, 0.5,0,0.6, 0.5,1,0.6, -0.5,1,0.6],"
    " \"triangles\": [0,1,2, 0,2,3], \"pattern\": [0,0, 1,0, 1,1, 0,1]}},"
    " \"bodies\": [{\"sphere\": {\"center\": [0,0.5,0], \"radius\": 0.4}},"
    " {\"capsule\": {\"a\": [0,0,0], \"b\": [0,1,0], \"radius\": 0.1}},"
    " {\"plane\": {\"point\": [0,-0.2,0], \"normal\": [0,2,0]}}, {\"mesh\": {\"ref\": \"abc\"}}]}";

static struct picture parse(const char *text)
{
    struct picture picture;
    struct failure failure;
    size_t skipped = 0;
    assert_int_equal(jobfile_parse("job", text, strlen(text), &picture, &skipped, &failure), 0);
    assert_int_equal(skipped, 1);
    return picture;
}

/* A result is draped on the last posture, the start hangs on the first. */
static void test_picture__a_body_that_moved_is_shown_where_it_arrived(void **state)
{
    const char moving[] =
        "{\"bodies\": [{\"mesh\": {\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,2]},"
        " \"motion\": [{\"positions\": [0,0,0, 5,0,0, 0,5,0]}, {\"positions\": [0,0,1, 1,0,1, 0,1,1]}]},"
        " {\"mesh\": {\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,2]}, \"motion\": []},"
        " {\"mesh\": {\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,2]},"
        " \"motion\": [{\"ref\": \"abc\"}]}]}";
    const char wrong[] =
        "{\"bodies\": [{\"mesh\": {\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,2]},"
        " \"motion\": [{\"positions\": [0,0,0]}]}]}";
    const char result[] = "{\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,2]}";
    struct picture picture = parse(moving), none;
    struct failure failure;
    size_t skipped;
    (void)state;
    assert_int_equal(picture.bodies, 2);
    assert_true(picture.body[0].mesh.positions[8] == 0);
    assert_int_equal(jobfile_set_result("r", result, strlen(result), NULL, &picture, &failure), 0);
    assert_true(picture.body[0].mesh.positions[8] == 1);
    assert_true(picture.body[1].mesh.positions[8] == 0);
    assert_int_equal(jobfile_parse("job", wrong, strlen(wrong), &none, &skipped, &failure), -1);
    picture_done(&picture);
}

/* Pixels in the left, middle and right third (front, side, back) that are more blue than red. */
static void count_blue(const char *path, size_t blue[3], size_t *ret_pixels)
{
    png_image image = {.version = PNG_IMAGE_VERSION};
    assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    unsigned char *pixel = malloc(PNG_IMAGE_SIZE(image));
    assert_non_null(pixel);
    assert_true(png_image_finish_read(&image, NULL, pixel, 0, NULL));
    assert_in_range(image.height, PICTURE_HEIGHT / 2, PICTURE_HEIGHT);
    assert_in_range(image.width, PICTURE_HEIGHT, PICTURE_WIDTH + 3);
    blue[0] = blue[1] = blue[2] = 0;
    *ret_pixels = (size_t)image.width * image.height / 3;
    for (size_t i = 0; i < (size_t)image.width * image.height; i++) {
        size_t third = 3 * (i % image.width) / image.width;
        blue[third] += pixel[3 * i + 2] > pixel[3 * i] + 20;
    }
    free(pixel);
}

static void test_picture__shows_cloth_before_the_body_and_hides_it_behind(void **state)
{
    char path[] = "/tmp/drape-test-XXXXXX";
    int file = mkstemp(path);
    struct picture picture = parse(job);
    struct failure failure;
    size_t blue[3], pixels = 0;
    (void)state;
    assert_true(file >= 0);
    close(file);
    assert_int_equal(picture.bodies, 3);
    assert_int_equal(picture_save(&picture, path, &failure), 0);
    count_blue(path, blue, &pixels);
    assert_true(blue[0] > pixels / 5);       /* the square faces the front view */
    assert_true(blue[1] < pixels / 50);      /* and is a line from the side */
    assert_true(blue[2] > pixels / 20);      /* behind the sphere its rim is seen */
    assert_true(blue[2] < blue[0] * 8 / 10); /* but not its middle */
    picture_done(&picture);
    unlink(path);
}

static void test_picture__takes_the_cloth_of_a_result(void **state)
{
    const char result[] = "{\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,2], \"normals\": []}";
    const char wrong[] = "{\"positions\": [0,0,0, 1,0,0, 0,1,0], \"triangles\": [0,1,3]}";
    struct picture picture = parse(job);
    struct failure failure;
    (void)state;
    assert_int_equal(jobfile_set_result("r", result, strlen(result), NULL, &picture, &failure), 0);
    assert_int_equal(picture.cloth.vertices, 3);
    assert_int_equal(jobfile_set_result("r", wrong, strlen(wrong), NULL, &picture, &failure), -1);
    assert_int_equal(jobfile_set_result("r", "glTF", 4, NULL, &picture, &failure), -1);
    assert_int_equal(jobfile_set_result("r", "{", 1, NULL, &picture, &failure), -1);
    assert_int_equal(picture.cloth.vertices, 3); /* as it was */
    picture_done(&picture);
}

/* Pixels of the front view that are nearer to yellow than to blue, and the other way round, by half. */
static void count_shades(const unsigned char *pixel, const png_image *image, size_t yellow[2],
                         size_t violet[2])
{
    for (size_t i = 0; i < (size_t)image->width * image->height; i++) {
        const unsigned char *p = pixel + 3 * i;
        size_t x = i % image->width, half = 6 * x / image->width;
        if (half < 2 && x > 40) { /* the bar is farther left */
            yellow[half] += p[0] > p[2] + 60 && p[1] > p[2] + 60;
            violet[half] += p[2] > p[1] + 20 && p[0] > p[1] + 10;
        }
    }
}

static void test_picture__shows_values_from_dark_to_light(void **state)
{
    char path[] = "/tmp/drape-test-XXXXXX";
    int file = mkstemp(path);
    struct picture picture = parse(job);
    struct failure failure;
    double range[2];
    (void)state;
    assert_true(file >= 0);
    close(file);
    picture.cloth.value = calloc(4, sizeof(double)); /* grows to the right */
    assert_non_null(picture.cloth.value);
    picture.cloth.value[1] = picture.cloth.value[2] = 20;
    picture_range(&picture, range);
    assert_true(range[0] == 0 && range[1] == 20);
    assert_int_equal(picture_save(&picture, path, &failure), 0);
    png_image image = {.version = PNG_IMAGE_VERSION};
    assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    unsigned char *pixel = malloc(PNG_IMAGE_SIZE(image));
    assert_non_null(pixel);
    assert_true(png_image_finish_read(&image, NULL, pixel, 0, NULL));
    size_t yellow[2] = {0}, violet[2] = {0};
    count_shades(pixel, &image, yellow, violet);
    print_message("yellow %zu left, %zu right; violet %zu left, %zu right\n", yellow[0], yellow[1], violet[0],
                  violet[1]);
    assert_true(yellow[1] > 5000 && yellow[0] < yellow[1] / 20);
    assert_true(violet[0] > 5000 && violet[1] < violet[0] / 20);
    const unsigned char top[3] = {0xFD, 0xE7, 0x25}, bottom[3] = {0x44, 0x01, 0x54};
    size_t bar = image.height / 3, first = image.height - bar - 12;
    assert_memory_equal(pixel + 3 * (first * image.width + 15), top, 3);
    assert_memory_equal(pixel + 3 * ((first + bar - 1) * image.width + 15), bottom, 3);
    free(pixel);
    picture.cloth.value[0] = -5;
    picture_range(&picture, range);
    assert_true(range[0] == -5 && range[1] == 20);
    picture_done(&picture);
    unlink(path);
}

static void put_u32(unsigned char *p, uint32_t v)
{
    for (int k = 0; k < 4; k++) {
        p[k] = (unsigned char)(v >> 8 * k);
    }
}

/* A GLB of one triangle with 16-bit indices and the pressure of its vertices; returns its length. */
static size_t make_glb(unsigned char *glb)
{
    char json[800];
    int n = snprintf(
        json, sizeof json, "%s%s%s", "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":56}],",
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,\"byteLength\":6},"
        "{\"buffer\":0,\"byteOffset\":44,\"byteLength\":12}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},",
        "{\"bufferView\":1,\"componentType\":5123,\"count\":3,\"type\":\"SCALAR\"},"
        "{\"bufferView\":2,\"componentType\":5126,\"count\":3,\"type\":\"SCALAR\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"_PRESSURE\":2},\"indices\":1}]}]}");
    size_t bytes = ((size_t)n + 3) / 4 * 4;
    const float position[9] = {0, 0, 0, 1, 0, 0, 0, 2, 0};
    const float pressure[3] = {0, 250, 1000};
    const unsigned char index[8] = {0, 0, 1, 0, 2, 0, 0, 0};
    memset(glb, ' ', 20 + bytes);
    put_u32(glb, 0x46546C67);
    put_u32(glb + 4, 2);
    put_u32(glb + 8, (uint32_t)(12 + 8 + bytes + 8 + 56));
    put_u32(glb + 12, (uint32_t)bytes);
    put_u32(glb + 16, 0x4E4F534A);
    memcpy(glb + 20, json, (size_t)n);
    put_u32(glb + 20 + bytes, 56);
    put_u32(glb + 24 + bytes, 0x004E4942);
    memcpy(glb + 28 + bytes, position, sizeof position);
    memcpy(glb + 28 + bytes + 36, index, sizeof index);
    memcpy(glb + 28 + bytes + 44, pressure, sizeof pressure);
    return 28 + bytes + 56;
}

static void test_picture__reads_a_glb_and_refuses_it_cut_short_anywhere(void **state)
{
    unsigned char glb[1024];
    size_t bytes = make_glb(glb);
    struct picture picture = {0};
    struct failure failure;
    (void)state;
    assert_int_equal(jobfile_set_result("x.glb", (char *)glb, bytes, NULL, &picture, &failure), 0);
    assert_int_equal(picture.cloth.triangles, 1);
    assert_close(picture.cloth.positions[7], 2, 0);
    assert_null(picture.cloth.value); /* without a wish it would be the strain */
    assert_int_equal(jobfile_set_result("x.glb", (char *)glb, bytes, "pressure", &picture, &failure), 0);
    assert_string_equal(picture.map->unit, "Pa");
    assert_close(picture.cloth.value[1], 250, 0);
    assert_int_equal(jobfile_set_result("x.glb", (char *)glb, bytes, "gap", &picture, &failure), -1);
    assert_non_null(strstr(failure.message, "has no gap"));
    assert_non_null(picture.cloth.value); /* as it was */
    assert_int_equal(jobfile_set_result("x.glb", (char *)glb, bytes, "none", &picture, &failure), 0);
    assert_null(picture.cloth.value);
    assert_null(picture.map);
    picture_done(&picture);
    for (size_t cut = 0; cut < bytes; cut++) {
        char *exact = malloc(cut + 1); /* so that a sanitizer sees reads past the end */
        assert_non_null(exact);
        memcpy(exact, glb, cut);
        exact = realloc(exact, cut > 0 ? cut : 1);
        assert_int_equal(jobfile_set_result("x.glb", exact, cut, "pressure", &picture, &failure), -1);
        free(exact);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_picture__shows_cloth_before_the_body_and_hides_it_behind),
        cmocka_unit_test(test_picture__shows_values_from_dark_to_light),
        cmocka_unit_test(test_picture__a_body_that_moved_is_shown_where_it_arrived),
        cmocka_unit_test(test_picture__takes_the_cloth_of_a_result),
        cmocka_unit_test(test_picture__reads_a_glb_and_refuses_it_cut_short_anywhere),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
