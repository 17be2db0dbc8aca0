bool inside(vec3 p) {
    return dot(unit_normal, p - point) < 0.0;
}
