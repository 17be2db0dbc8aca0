// A corner of a wireframe, whose sizes are larger by some standard deviations.

layout(location = 0) in vec3 instance_place;
layout(location = 1) in vec3 instance_change;  // by a standard deviation

uniform float deviations;

out float ahead; // what the depth buffer is to hold

void main() {
    vec3 p = in_view(instance_place + deviations * instance_change);
    ahead = p.z - lift;
    gl_Position = clip_of_point(p);
}
