"""The cloth of a draped job by Blender's cloth modifier, for `make bench`.

usage: blender --background --factory-startup --threads 1 --python blender.py -- JOB FRAMES

Prints one line a frame: "row FRAME CPU_SECONDS GRAVITY_J SPEED", CPU_SECONDS of the process from the first frame on,
GRAVITY_J the potential energy in gravity relative to the start, SPEED (m/s) of the fastest vertex from frame to frame.
Blender's springs have no elastic energy that could be compared; that in gravity means the same to both programs.
Pinned vertices are held. Its default damping (5 of springs, 1 of air) holds so light a cloth up for minutes: the springs
have none here, and the air the 0.02 with which it came to its end soonest of 0, 0.02 and 1."""
import json
import sys
import time

import bpy
import numpy

path, frames = sys.argv[sys.argv.index("--") + 1 :]
with open(path) as file:
    job = json.load(file)
cloth, mesh_of = job["cloth"], job["cloth"]["mesh"]
start = numpy.array(mesh_of["positions"]).reshape(-1, 3)
triangles = numpy.array(mesh_of["triangles"]).reshape(-1, 3)
material = cloth["materials"][0]
edge = numpy.cross(start[triangles[:, 1]] - start[triangles[:, 0]], start[triangles[:, 2]] - start[triangles[:, 0]])
area = 0.5 * numpy.linalg.norm(edge, axis=1)
mass = numpy.bincount(triangles.ravel(), numpy.repeat(area, 3) / 3, len(start)) * material["density"]

scene = bpy.context.scene
for thing in list(bpy.data.objects):
    bpy.data.objects.remove(thing)
mesh = bpy.data.meshes.new("cloth")
mesh.from_pydata(start.tolist(), [], triangles.tolist())
thing = bpy.data.objects.new("cloth", mesh)
scene.collection.objects.link(thing)
pins = thing.vertex_groups.new(name="pins")
pins.add(cloth["pins"], 1.0, "REPLACE")
scene.gravity = job.get("gravity", [0, -9.81, 0])
scene.render.fps = 25
scene.frame_end = int(frames)

modifier = thing.modifiers.new("cloth", "CLOTH")
settings = modifier.settings
settings.vertex_group_mass = "pins"
settings.mass = float(mass.mean())
settings.tension_stiffness = settings.compression_stiffness = material["stretch"]["weft"]
settings.shear_stiffness = material["stretch"]["shear"]
settings.bending_stiffness = 0.01
settings.tension_damping = settings.compression_damping = settings.shear_damping = settings.bending_damping = 0
settings.air_damping = 0.02
modifier.collision_settings.use_collision = False
modifier.point_cache.frame_end = int(frames)

last, began = start, None
for frame in range(1, int(frames) + 1):
    scene.frame_set(frame)
    shape = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    now = numpy.empty(3 * len(shape.vertices))
    shape.vertices.foreach_get("co", now)
    now = now.reshape(-1, 3)
    began = time.process_time() if began is None else began
    energy = -float((mass[:, None] * (now - start) * numpy.array(scene.gravity)).sum())
    speed = float(numpy.linalg.norm(now - last, axis=1).max()) * scene.render.fps
    print("row", frame, time.process_time() - began, energy, speed, flush=True)
    last = now
