// First surface of a box on the ray of a pixel.
//
// It is where three slabs overlap; the slab entered last (or, from inside, left first)
// tells the face. Formulas and names are those of primitives/box.py. Fields: center,
// rotation, size.

// Where the ray enters the three slabs and leaves them, less the parameter that comes
// first.
void slabs(vec3 o, vec3 d, out float foot, out vec3 ins, out vec3 outs) {
    // Towards the point of the box nearest to the camera. v * rotation: v along the edges.
    vec3 half_size = size / 2.0;
    vec3 nearest = rotation * clamp((o - center) * rotation, -half_size, half_size);
    vec3 near = brought_near(o, d, center, center + nearest, 0.0, foot);
    Interval x = slab_interval(near, d, rotation[0], half_size.x);
    Interval y = slab_interval(near, d, rotation[1], half_size.y);
    Interval z = slab_interval(near, d, rotation[2], half_size.z);
    ins = vec3(x.lower, y.lower, z.lower);
    outs = vec3(x.upper, y.upper, z.upper);
}

// Through which the ray enters the box, or leaves it; bounds are those of the slabs, the
// largest of which is the box's.
int face_of(vec3 bounds, vec3 d, bool enters) {
    int across = bounds.x >= max(bounds.y, bounds.z) ? 0 : bounds.y >= bounds.z ? 1 : 2;
    // A face that the ray enters looks against it, one that it leaves along it.
    return 2 * across + int((dot(d, rotation[across]) > 0.0) != enters);
}

vec3 normal_at(vec3 p, int part) {
    return normalize(rotation[part / 2]);
}

Surface intersect(vec3 o, vec3 d) {
    float foot;
    vec3 ins, outs;
    slabs(o, d, foot, ins, outs);
    float lower = max(max(ins.x, ins.y), ins.z);
    float upper = min(min(outs.x, outs.y), outs.z);
    float enter = foot + lower, leave = foot + upper;
    if (!(lower <= upper && leave > 0.0)) return MISS;
    bool enters = enter > 0.0;
    int face = face_of(enters ? ins : -outs, d, enters);
    return Surface(enters ? enter : leave, facing(normal_at(o, face), d), face);
}
