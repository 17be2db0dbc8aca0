// Stretch of a ray behind the side that the normal points to; there is no other.
Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    float height = dot(unit_normal, point - o), n_d = dot(unit_normal, d);
    bool meets = abs(n_d) > SMALLEST_SLOPE;
    again = NOWHERE;
    if (!(meets || height >= 0.0)) return NOWHERE;
    float t = height / (meets ? n_d : 1.0);
    return Stretch(
        End(meets && n_d < 0.0 ? t : -INFINITE, 0, abs(n_d)),
        End(meets && n_d > 0.0 ? t : INFINITE, 0, abs(n_d))
    );
}
