// First surface of a sphere on the ray of a pixel.
//
// Of the two ends of the ray's stretch in the ball, the first in front of the camera.
// Formulas and names are those of primitives/sphere.py. Fields: center, radius.

Surface intersect(vec3 o, vec3 d) {
    float foot;
    vec3 near = brought_near(o, d, center, center, radius, foot);
    Interval ball = ball_interval(near, d, radius);
    float enter = foot + ball.lower, leave = foot + ball.upper;
    if (!(enter <= leave && leave > 0.0)) return MISS;
    float t = enter > 0.0 ? enter : leave;
    return Surface(t, facing(normalize(o + d * t - center), d), 0);
}
