// First surface of a sphere on the ray of a pixel.
//
// Of the two ends of the ray's stretch in the ball, the first in front of the camera.
// Formulas and names are those of primitives/sphere.py. Fields: center, radius.

// Stretch of the ray in the ball, less the parameter that comes first.
Interval ball_of(vec3 o, vec3 d, out float foot) {
    vec3 near = brought_near(o, d, center, center, radius, foot);
    return ball_interval(near, d, radius);
}

vec3 normal_at(vec3 p, int part) {
    return normalize(p - center);
}

Surface intersect(vec3 o, vec3 d) {
    float foot;
    Interval ball = ball_of(o, d, foot);
    float enter = foot + ball.lower, leave = foot + ball.upper;
    if (!(enter <= leave && leave > 0.0)) return MISS;
    float t = enter > 0.0 ? enter : leave;
    return Surface(t, facing(normal_at(o + d * t, 0), d), 0);
}
