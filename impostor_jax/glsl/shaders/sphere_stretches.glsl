// Stretch of a ray in the ball; there is no other.
Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    float foot;
    Interval ball = ball_of(o, d, foot);
    again = NOWHERE;
    if (!(ball.lower <= ball.upper)) return NOWHERE;
    float slope = dot(d, d) * ((ball.upper - ball.lower) / 2.0) / radius;
    return Stretch(End(foot + ball.lower, 0, slope), End(foot + ball.upper, 0, slope));
}
