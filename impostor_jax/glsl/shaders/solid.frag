// First surface of a solid made of others on the ray of a pixel.
//
// Of all ends of the stretches that the ray spends in the shapes, it is the first in front
// of the camera where the expression, asked of the places just before it and just after it,
// changes. Formulas and names are those of primitives/solid.py. What is asked of the shapes
// is made from the expression (solid_program.py): `ends`, found by `cross_all`; `is_in` of a
// place on the ray; `normal_at`. Fields: center, size, of the box that is seen; rotation and
// translation, of the shapes; middle and radius, of the ball that holds it among them;
// farthest, how far they reach there.

Surface intersect(vec3 origin, vec3 direction) {
    // v * rotation: v in the frame of the shapes. What is turned is near already.
    float foot;
    vec3 target = translation + rotation * middle;
    vec3 near = brought_near(origin, direction, translation, target, radius, foot);
    vec3 d = direction * rotation;
    near = near * rotation;
    cross_all(near, d);
    float speed = length(d), lengths = length(near) + farthest, t = INFINITE;
    int part = 0;
    for (int k = 0; k < NUM_ENDS; k++) {
        float at = ends[k].t;
        if (!(abs(at) < INFINITE && foot + at > 0.0 && at < t)) continue;
        float room = 4.0 * EPS * (lengths + abs(at) * speed) / ends[k].slope;
        if (is_in(at - room) == is_in(at + room)) continue;
        t = at;
        part = ends[k].part;
    }
    if (t >= INFINITE) return MISS;
    vec3 n = rotation * normal_at(near + d * t, part);
    return Surface(foot + t, facing(n, direction), part);
}
