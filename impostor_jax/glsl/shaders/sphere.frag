// First surface of a sphere on the ray of a pixel.
//
// Of the two ends of the ray's stretch in the ball, the first in front of the camera.
// Formulas and names are those of primitives/sphere.py. Fields: center, radius.

#ifdef AS_PUBLISHED

Surface intersect(vec3 o, vec3 d) {
    vec3 c = center - o, v = normalize(d);
    float t_ca = dot(c, v);
    // Two large numbers, nearly equal.
    float gap = radius * radius - (dot(c, c) - t_ca * t_ca);
    if (gap < 0.0) return MISS;
    // Only the nearest root, even behind the camera.
    float t = (t_ca - sqrt(gap)) / length(d);
    if (!(t > 0.0)) return MISS;
    return Surface(t, (o + t * d - center) / radius, 0);
}

#else

Surface intersect(vec3 o, vec3 d) {
    float foot;
    vec3 near = brought_near(o, d, center, center, radius, foot);
    Interval ball = ball_interval(near, d, radius);
    float enter = foot + ball.lower, leave = foot + ball.upper;
    if (!(enter <= leave && leave > 0.0)) return MISS;
    float t = enter > 0.0 ? enter : leave;
    return Surface(t, facing(normalize(o + d * t - center), d), 0);
}

#endif
