// Stretch of a ray in the box; there is no other.
Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    float foot;
    vec3 ins, outs;
    slabs(o, d, foot, ins, outs);
    float lower = max(max(ins.x, ins.y), ins.z);
    float upper = min(min(outs.x, outs.y), outs.z);
    again = NOWHERE;
    if (!(lower <= upper)) return NOWHERE;
    int into = face_of(ins, d, true), out_of = face_of(-outs, d, false);
    return Stretch(
        End(foot + lower, into, abs(dot(d, rotation[into / 2]))),
        End(foot + upper, out_of, abs(dot(d, rotation[out_of / 2])))
    );
}
