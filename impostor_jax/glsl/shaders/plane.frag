// An endless plane on the ray of a pixel, which crosses it once or never.
//
// Formulas and names are those of primitives/plane.py. Fields: point, unit_normal.

vec3 normal_at(vec3 p, int part) {
    return unit_normal;
}

Surface intersect(vec3 o, vec3 d) {
    float height = dot(unit_normal, point - o), n_d = dot(unit_normal, d);
    if (abs(n_d) <= SMALLEST_SLOPE) return MISS;
    float t = height / n_d;
    if (!(t > 0.0)) return MISS;
    return Surface(t, facing(unit_normal, d), 0);
}
