// First surface of a box on the ray of a pixel.
//
// It is where three slabs overlap; the slab entered last (or, from inside, left first)
// tells the face. Formulas and names are those of primitives/box.py. Fields: center,
// rotation, size.

Surface intersect(vec3 o, vec3 d) {
    // Towards the point of the box nearest to the camera. v * rotation: v along the edges.
    vec3 half_size = size / 2.0;
    vec3 nearest = rotation * clamp((o - center) * rotation, -half_size, half_size);
    float foot;
    vec3 near = brought_near(o, d, center, center + nearest, 0.0, foot);
    Interval x = slab_interval(near, d, rotation[0], half_size.x);
    Interval y = slab_interval(near, d, rotation[1], half_size.y);
    Interval z = slab_interval(near, d, rotation[2], half_size.z);
    float lower = max(max(x.lower, y.lower), z.lower);
    float upper = min(min(x.upper, y.upper), z.upper);
    float enter = foot + lower, leave = foot + upper;
    if (!(lower <= upper && leave > 0.0)) return MISS;
    bool enters = enter > 0.0;
    vec3 bounds = enters ? vec3(x.lower, y.lower, z.lower)
                         : -vec3(x.upper, y.upper, z.upper);
    int across = bounds.x >= max(bounds.y, bounds.z) ? 0 : bounds.y >= bounds.z ? 1 : 2;
    vec3 a = rotation[across];
    // A face that the ray enters looks against it, one that it leaves along it.
    int face = 2 * across + int((dot(d, a) > 0.0) != enters);
    return Surface(enters ? enter : leave, facing(normalize(a), d), face);
}
