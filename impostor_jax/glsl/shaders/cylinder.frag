// First surface of a capped cylinder on the ray of a pixel.
//
// The wall's interval of the ray meets the slab's; the bound entered last (or, from
// inside, left first) is the surface. Formulas and names are those of
// primitives/cylinder.py. Fields: center, axis, radius, height.

// Stretches of the ray in both, less the parameter that comes first.
void wall_and_slab(vec3 o, vec3 d, out float foot, out Interval wall, out Interval slab) {
    // Towards the point of the axis nearest to the camera.
    float half_height = height / 2.0;
    float level = clamp(dot(o - center, axis), -half_height, half_height);
    vec3 near = brought_near(o, d, center, center + axis * level, radius, foot);
    wall = wall_interval(near, d, axis, radius);
    slab = slab_interval(near, d, axis, half_height);
}

vec3 normal_at(vec3 p, int part) {
    vec3 q = p - center;
    return part == 1 ? axis : normalize(q - axis * dot(q, axis));
}

Surface intersect(vec3 o, vec3 d) {
    float foot;
    Interval wall, slab;
    wall_and_slab(o, d, foot, wall, slab);
    float enter = foot + max(wall.lower, slab.lower);
    float leave = foot + min(wall.upper, slab.upper);
    if (!(enter <= leave && leave > 0.0)) return MISS;
    bool outside = enter > 0.0;
    bool on_cap = outside ? slab.lower > wall.lower : slab.upper < wall.upper;
    float t = outside ? enter : leave;
    return Surface(t, facing(normal_at(o + d * t, int(on_cap)), d), int(on_cap));
}
