/* picture.c - draws cloth and bodies with OSMesa (OpenGL into memory) and saves them with libpng.
 *
 * Parallel projection, one scale for all views, so that lengths can be compared between them. Each
 * view is drawn SUPERSAMPLE times too large and averaged down. */
#include "picture.h"

#include <GL/glu.h>
#include <GL/osmesa.h>
#include <errno.h>
#include <math.h>
#include <png.h>
#include <stdlib.h>
#include <string.h>

#define SUPERSAMPLE 3
#define DEPTH_BITS  24
/* The eye looks down by this much, to show hems and shoulders from inside and above (degrees). */
#define ELEVATION 9.0
/* Width of a view over its height stays in this range. */
#define NARROWEST 0.40
#define WIDEST    1.60
/* Free room around what is shown, and how far beyond the cloth a body is still fitted in, both
 * relative to the cloth's size. */
#define MARGIN 1.06
#define AROUND 0.18

/* What the eye turns to, about the vertical: 0 sees the front (+z), 90 the wearer's left (+x). */
static const double azimuths[] = {0, 90, 180};
enum { VIEWS = sizeof azimuths / sizeof azimuths[0] };

#ifdef __SANITIZE_ADDRESS__
/* Mesa keeps a few hundred bytes of a destroyed context; the leak checker should not blame us. */
const char *__lsan_default_suppressions(void);
const char *__lsan_default_suppressions(void)
{
    return "leak:libOSMesa";
}
#endif

const struct picture_map picture_maps[] = {{"strain", "_STRAIN", "%", 100},
                                           {"pressure", "_PRESSURE", "Pa", 1},
                                           {"gap", "_GAP", "mm", 1000},
                                           {"none", NULL, "", 1},
                                           {NULL, NULL, NULL, 0}};

/* Five even stops of viridis (S. van der Walt, N. Smith and E. Firing, in Matplotlib; CC0): lightness rises
 * evenly, for colour-blind eyes too. */
static const unsigned char stops[][3] = {
    {0x44, 0x01, 0x54}, {0x3B, 0x52, 0x8B}, {0x21, 0x91, 0x8C}, {0x5E, 0xC9, 0x62}, {0xFD, 0xE7, 0x25}};
enum { STOPS = sizeof stops / sizeof stops[0] };

/* The bar of colours: pixels from the left edge and its width, and its part of the image's height. */
enum { BAR_LEFT = 12, BAR_WIDTH = 14, BAR_PART = 3 };

struct frame { /* of one picture, common to its views */
    double centre[3];
    double half_width, half_height, half_depth; /* m, in view directions */
    int width, height;                          /* pixels of one view, before supersampling */
};

struct box {
    double low[3], high[3];
};

void picture_done(struct picture *picture)
{
    surface_done(&picture->cloth);
    for (size_t b = 0; b < picture->bodies; b++) {
        surface_done(&picture->body[b].mesh);
        free(picture->body[b].arrived);
    }
    free(picture->body);
    *picture = (struct picture){0};
}

/* ---- colours ----------------------------------------------------------------------------------- */

const struct picture_map *picture_map_find(const char *name)
{
    const struct picture_map *map = picture_maps;
    while (map->name && strcmp(map->name, name) != 0) {
        map++;
    }
    return map->name ? map : NULL;
}

void picture_range(const struct picture *picture, double ret[2])
{
    ret[0] = ret[1] = 0;
    for (size_t i = 0; picture->cloth.value && i < picture->cloth.vertices; i++) {
        ret[0] = fmin(ret[0], picture->cloth.value[i]); /* fmin passes over a NAN */
        ret[1] = fmax(ret[1], picture->cloth.value[i]);
    }
}

/* Of a value from 0 to 1, linear between the stops. */
static void shade(double value, unsigned char ret[3])
{
    double at = fmin(1, fmax(0, value)) * (STOPS - 1);
    size_t low = at < STOPS - 2 ? (size_t)at : STOPS - 2;
    for (int k = 0; k < 3; k++) {
        ret[k] =
            (unsigned char)lround(stops[low][k] + (at - (double)low) * (stops[low + 1][k] - stops[low][k]));
    }
}

/* 3*vertices, to be freed; NULL when out of memory. */
static unsigned char *shade_cloth(const struct picture *picture)
{
    double range[2];
    unsigned char *colour = malloc(3 * picture->cloth.vertices);
    picture_range(picture, range);
    for (size_t i = 0; colour && i < picture->cloth.vertices; i++) {
        double width = range[1] - range[0];
        shade(width > 0 ? (picture->cloth.value[i] - range[0]) / width : 0, colour + 3 * i);
    }
    return colour;
}

/* ---- framing ----------------------------------------------------------------------------------- */

static struct box box_empty(void)
{
    return (struct box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

static void box_add(struct box *box, const double *x)
{
    for (int k = 0; k < 3; k++) {
        box->low[k] = fmin(box->low[k], x[k]);
        box->high[k] = fmax(box->high[k], x[k]);
    }
}

static void box_add_ball(struct box *box, const double *x, double radius)
{
    for (int k = 0; k < 3; k++) {
        box->low[k] = fmin(box->low[k], x[k] - radius);
        box->high[k] = fmax(box->high[k], x[k] + radius);
    }
}

static struct box body_box(const struct picture_body *body)
{
    struct box box = box_empty();
    if (body->shape == PICTURE_MESH) {
        for (size_t i = 0; i < body->mesh.vertices; i++) {
            box_add(&box, body->mesh.positions + 3 * i);
        }
    } else if (body->shape == PICTURE_SPHERE) {
        box_add_ball(&box, body->point, body->radius);
    } else if (body->shape == PICTURE_CAPSULE) {
        box_add_ball(&box, body->point, body->radius);
        box_add_ball(&box, body->axis, body->radius);
    }
    return box;
}

/* The cloth, and of the bodies what lies near it. */
static struct box visible_box(const struct picture *picture)
{
    struct box cloth = box_empty(), shown;
    for (size_t i = 0; i < picture->cloth.vertices; i++) {
        box_add(&cloth, picture->cloth.positions + 3 * i);
    }
    shown = cloth;
    double size = 0;
    for (int k = 0; k < 3; k++) {
        size = fmax(size, cloth.high[k] - cloth.low[k]);
    }
    for (size_t b = 0; b < picture->bodies; b++) {
        struct box body = body_box(&picture->body[b]);
        for (int k = 0; k < 3; k++) {
            shown.low[k] = fmin(shown.low[k], fmax(body.low[k], cloth.low[k] - AROUND * size));
            shown.high[k] = fmax(shown.high[k], fmin(body.high[k], cloth.high[k] + AROUND * size));
        }
    }
    return shown;
}

static struct frame fit_frame(const struct picture *picture)
{
    struct frame frame = {0};
    struct box box = visible_box(picture);
    double size[3];
    for (int k = 0; k < 3; k++) {
        frame.centre[k] = (box.low[k] + box.high[k]) / 2;
        size[k] = fmax(box.high[k] - box.low[k], 1e-6);
    }
    double sine = sin(ELEVATION * M_PI / 180), cosine = cos(ELEVATION * M_PI / 180);
    double wide = fmax(size[0], size[2]), high = size[1] * cosine + wide * sine;
    double aspect = fmin(WIDEST, fmax(NARROWEST, wide / high));
    frame.half_height = MARGIN * fmax(high, wide / aspect) / 2;
    frame.half_width = frame.half_height * aspect;
    /* bodies reach beyond the box: room for all of them, and for a plane's patch */
    frame.half_depth = 20 * (wide + high);
    frame.height = (int)lround(fmin(PICTURE_HEIGHT, PICTURE_WIDTH / (VIEWS * aspect)));
    frame.width = (int)lround(frame.height * aspect);
    return frame;
}

/* ---- drawing ----------------------------------------------------------------------------------- */

static void set_light(GLenum light, float x, float y, float z, float brightness)
{
    const float direction[4] = {x, y, z, 0};
    const float colour[4] = {brightness, brightness, brightness, 1};
    const float black[4] = {0, 0, 0, 1};
    glLightfv(light, GL_POSITION, direction);
    glLightfv(light, GL_DIFFUSE, colour);
    glLightfv(light, GL_AMBIENT, black);
    glLightfv(light, GL_SPECULAR, black);
    glEnable(light);
}

/* Key, fill and rim light, fixed to the eye. */
static void set_lights(void)
{
    const float ambient[4] = {0.22f, 0.22f, 0.24f, 1};
    glMatrixMode(GL_MODELVIEW);
    glLoadIdentity();
    set_light(GL_LIGHT0, -0.9f, 0.6f, 0.6f, 0.72f);
    set_light(GL_LIGHT1, 0.8f, 0.2f, 0.7f, 0.26f);
    set_light(GL_LIGHT2, 0.0f, 1.0f, -0.2f, 0.12f);
    glLightModelfv(GL_LIGHT_MODEL_AMBIENT, ambient);
    glLightModeli(GL_LIGHT_MODEL_TWO_SIDE, GL_TRUE);
    glEnable(GL_LIGHTING);
    glEnable(GL_NORMALIZE);
}

static void set_colour(GLenum face, float red, float green, float blue)
{
    const float colour[4] = {red, green, blue, 1};
    glMaterialfv(face, GL_AMBIENT_AND_DIFFUSE, colour);
}

static void set_camera(const struct frame *frame, double azimuth)
{
    glMatrixMode(GL_PROJECTION);
    glLoadIdentity();
    glOrtho(-frame->half_width, frame->half_width, -frame->half_height, frame->half_height,
            -frame->half_depth, frame->half_depth);
    glMatrixMode(GL_MODELVIEW);
    glLoadIdentity();
    glRotated(ELEVATION, 1, 0, 0);
    glRotated(-azimuth, 0, 1, 0);
    glTranslated(-frame->centre[0], -frame->centre[1], -frame->centre[2]);
}

static int draw_surface(const struct surface *surface)
{
    float *normals = surface_normals(surface);
    if (!normals) {
        return -1;
    }
    glEnableClientState(GL_VERTEX_ARRAY);
    glEnableClientState(GL_NORMAL_ARRAY);
    glVertexPointer(3, GL_DOUBLE, 0, surface->positions);
    glNormalPointer(GL_FLOAT, 0, normals);
    glDrawElements(GL_TRIANGLES, (GLsizei)(3 * surface->triangles), GL_UNSIGNED_INT, surface->triangle);
    glDisableClientState(GL_NORMAL_ARRAY);
    glDisableClientState(GL_VERTEX_ARRAY);
    glFinish();
    free(normals);
    return 0;
}

static void draw_ball(GLUquadric *quadric, const double *centre, double radius)
{
    glPushMatrix();
    glTranslated(centre[0], centre[1], centre[2]);
    gluSphere(quadric, radius, 96, 64);
    glPopMatrix();
}

/* Turns the z axis into `direction` (any length > 0). */
static void turn_z_to(const double *direction)
{
    double length =
        sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    double angle = acos(fmax(-1, fmin(1, direction[2] / length))) * 180 / M_PI;
    bool along_z = hypot(direction[0], direction[1]) < 1e-12 * length;
    glRotated(angle, along_z ? 1 : -direction[1], along_z ? 0 : direction[0], 0);
}

static void draw_capsule(GLUquadric *quadric, const struct picture_body *body)
{
    double axis[3], length2 = 0;
    for (int k = 0; k < 3; k++) {
        axis[k] = body->axis[k] - body->point[k];
        length2 += axis[k] * axis[k];
    }
    draw_ball(quadric, body->point, body->radius);
    draw_ball(quadric, body->axis, body->radius);
    if (length2 > 0) {
        glPushMatrix();
        glTranslated(body->point[0], body->point[1], body->point[2]);
        turn_z_to(axis);
        gluCylinder(quadric, body->radius, body->radius, sqrt(length2), 96, 1);
        glPopMatrix();
    }
}

/* A square patch of the plane under the middle of the picture. */
static void draw_plane(const struct picture_body *body, const struct frame *frame)
{
    double length2 = 0, height = 0, foot[3], size = 1.5 * fmax(frame->half_width, frame->half_height);
    for (int k = 0; k < 3; k++) {
        length2 += body->axis[k] * body->axis[k];
        height += body->axis[k] * (frame->centre[k] - body->point[k]);
    }
    if (!(length2 > 0)) {
        return;
    }
    for (int k = 0; k < 3; k++) {
        foot[k] = frame->centre[k] - body->axis[k] * height / length2;
    }
    glPushMatrix();
    glTranslated(foot[0], foot[1], foot[2]);
    turn_z_to(body->axis);
    glBegin(GL_QUADS);
    glNormal3d(0, 0, 1);
    glVertex3d(-size, -size, 0);
    glVertex3d(size, -size, 0);
    glVertex3d(size, size, 0);
    glVertex3d(-size, size, 0);
    glEnd();
    glPopMatrix();
}

static int draw_bodies(const struct picture *picture, const struct frame *frame)
{
    GLUquadric *quadric = gluNewQuadric();
    if (!quadric) {
        return -1;
    }
    int status = 0;
    for (size_t b = 0; b < picture->bodies && status == 0; b++) {
        const struct picture_body *body = &picture->body[b];
        switch (body->shape) {
        case PICTURE_MESH:
            status = draw_surface(&body->mesh);
            break;
        case PICTURE_SPHERE:
            draw_ball(quadric, body->point, body->radius);
            break;
        case PICTURE_CAPSULE:
            draw_capsule(quadric, body);
            break;
        case PICTURE_PLANE:
            draw_plane(body, frame);
            break;
        }
    }
    gluDeleteQuadric(quadric);
    return status;
}

/* In the colours of its values, on both sides. */
static int draw_shaded(const struct picture *picture)
{
    unsigned char *colour = shade_cloth(picture);
    if (!colour) {
        return -1;
    }
    glColorMaterial(GL_FRONT_AND_BACK, GL_AMBIENT_AND_DIFFUSE);
    glEnable(GL_COLOR_MATERIAL);
    glEnableClientState(GL_COLOR_ARRAY);
    glColorPointer(3, GL_UNSIGNED_BYTE, 0, colour);
    int status = draw_surface(&picture->cloth);
    glDisableClientState(GL_COLOR_ARRAY);
    glDisable(GL_COLOR_MATERIAL);
    free(colour);
    return status;
}

static int draw_view(const struct picture *picture, const struct frame *frame, double azimuth)
{
    glViewport(0, 0, frame->width * SUPERSAMPLE, frame->height * SUPERSAMPLE);
    glClearColor(0.965f, 0.960f, 0.945f, 1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glEnable(GL_DEPTH_TEST);
    set_lights();
    set_camera(frame, azimuth);
    set_colour(GL_FRONT_AND_BACK, 0.80f, 0.72f, 0.65f);
    if (draw_bodies(picture, frame) < 0) {
        return -1;
    }
    if (picture->cloth.value) {
        return draw_shaded(picture);
    }
    set_colour(GL_FRONT, 0.36f, 0.58f, 0.90f);
    set_colour(GL_BACK, 0.56f, 0.63f, 0.76f);
    return draw_surface(&picture->cloth);
}

/* ---- image ------------------------------------------------------------------------------------- */

/* Averages the supersampled RGBA view (bottom row first, as OpenGL has it) into its place in the
 * RGB image (top row first). */
static void average_view(const unsigned char *large, const struct frame *frame, size_t view,
                         unsigned char *image)
{
    size_t width = (size_t)frame->width, height = (size_t)frame->height, stride = width * SUPERSAMPLE;
    for (size_t y = 0; y < height; y++) {
        for (size_t x = 0; x < width; x++) {
            unsigned sum[3] = {0};
            for (size_t s = 0; s < SUPERSAMPLE * SUPERSAMPLE; s++) {
                size_t row = (height - 1 - y) * SUPERSAMPLE + s / SUPERSAMPLE;
                const unsigned char *pixel = large + 4 * (row * stride + x * SUPERSAMPLE + s % SUPERSAMPLE);
                for (int k = 0; k < 3; k++) {
                    sum[k] += pixel[k];
                }
            }
            unsigned char *out = image + 3 * (y * width * VIEWS + view * width + x);
            for (int k = 0; k < 3; k++) {
                out[k] = (unsigned char)(sum[k] / (SUPERSAMPLE * SUPERSAMPLE));
            }
        }
    }
}

/* The bar of the colours, the largest value on top. */
static void draw_bar(const struct frame *frame, unsigned char *image)
{
    size_t width = (size_t)frame->width * VIEWS, height = (size_t)frame->height, bar = height / BAR_PART;
    for (size_t y = 0; y < bar; y++) {
        unsigned char colour[3];
        shade(1 - (double)y / (double)(bar - 1), colour);
        for (size_t x = BAR_LEFT; x < BAR_LEFT + BAR_WIDTH && x < width; x++) {
            memcpy(image + 3 * ((height - bar - BAR_LEFT + y) * width + x), colour, sizeof colour);
        }
    }
}

static int save_png(const unsigned char *image, const struct frame *frame, const char *path,
                    struct failure *failure)
{
    png_image png = {.version = PNG_IMAGE_VERSION, .format = PNG_FORMAT_RGB};
    png.width = (png_uint_32)frame->width * VIEWS;
    png.height = (png_uint_32)frame->height;
    if (!png_image_write_to_file(&png, path, 0, image, 0, NULL)) {
        return failure_set(failure, EXIT_LOCAL, "cannot write %s: %s", path, png.message);
    }
    return 0;
}

int picture_save(const struct picture *picture, const char *path, struct failure *failure)
{
    int status = -1;
    if (picture->cloth.vertices == 0) {
        return failure_set(failure, EXIT_USAGE, "there is no cloth to show");
    }
    struct frame frame = fit_frame(picture);
    size_t pixels = (size_t)frame.width * (size_t)frame.height;
    unsigned char *image = malloc(3 * VIEWS * pixels);
    unsigned char *large = malloc(4 * SUPERSAMPLE * SUPERSAMPLE * pixels);
    OSMesaContext context = OSMesaCreateContextExt(OSMESA_RGBA, DEPTH_BITS, 0, 0, NULL);
    if (!image || !large || !context ||
        !OSMesaMakeCurrent(context, large, GL_UNSIGNED_BYTE, frame.width * SUPERSAMPLE,
                           frame.height * SUPERSAMPLE)) {
        failure_set(failure, EXIT_LOCAL, "cannot start the renderer (out of memory?)");
        goto cleanup;
    }
    for (size_t view = 0; view < VIEWS; view++) {
        if (draw_view(picture, &frame, azimuths[view]) < 0) {
            failure_no_memory(failure);
            goto cleanup;
        }
        glFinish();
        average_view(large, &frame, view, image);
    }
    if (picture->cloth.value) {
        draw_bar(&frame, image);
    }
    status = save_png(image, &frame, path, failure);
cleanup:
    if (context) {
        OSMesaDestroyContext(context);
    }
    free(large);
    free(image);
    return status;
}
