// Stretch of a ray in the solid; there is no other.
Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    float foot;
    Interval wall, slab;
    wall_and_slab(o, d, foot, wall, slab);
    bool by_cap = slab.lower > wall.lower, through_cap = slab.upper < wall.upper;
    float lower = by_cap ? slab.lower : wall.lower;
    float upper = through_cap ? slab.upper : wall.upper;
    again = NOWHERE;
    if (!(lower <= upper)) return NOWHERE;
    float d_a = dot(d, axis);
    vec3 e = d - axis * d_a;
    float of_wall = dot(e, e) * ((wall.upper - wall.lower) / 2.0) / radius;
    return Stretch(
        End(foot + lower, int(by_cap), by_cap ? abs(d_a) : of_wall),
        End(foot + upper, int(through_cap), through_cap ? abs(d_a) : of_wall)
    );
}
