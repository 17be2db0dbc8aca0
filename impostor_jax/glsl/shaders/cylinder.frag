// First surface of a capped cylinder on the ray of a pixel.
//
// The wall's interval of the ray meets the slab's; the bound entered last (or, from
// inside, left first) is the surface. Formulas and names are those of
// primitives/cylinder.py. Fields: center, axis, radius, height.

Surface intersect(vec3 o, vec3 d) {
    // Towards the point of the axis nearest to the camera.
    float half_height = height / 2.0, foot;
    float level = clamp(dot(o - center, axis), -half_height, half_height);
    vec3 near = brought_near(o, d, center, center + axis * level, radius, foot);
    Interval wall = wall_interval(near, d, axis, radius);
    Interval slab = slab_interval(near, d, axis, half_height);
    float enter = foot + max(wall.lower, slab.lower);
    float leave = foot + min(wall.upper, slab.upper);
    if (!(enter <= leave && leave > 0.0)) return MISS;
    bool outside = enter > 0.0;
    bool on_cap = outside ? slab.lower > wall.lower : slab.upper < wall.upper;
    float t = outside ? enter : leave;

    vec3 q = o + d * t - center;
    vec3 n = on_cap ? axis : normalize(q - axis * dot(q, axis));
    return Surface(t, facing(n, d), int(on_cap));
}
