// Behind the side that the normal points to.
bool inside(vec3 p) {
    return dot(unit_normal(), p - corners[0]) < 0.0;
}
