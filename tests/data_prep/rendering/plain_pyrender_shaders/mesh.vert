#version 330 core
// Names of attributes and uniforms are pyrender's (0.1.45): it binds them by name.
layout(location = 0) in vec3 position;
#ifdef COLOR_0_LOC
layout(location = COLOR_0_LOC) in vec4 color_0;
flat out vec3 face_color;
#endif
layout(location = INST_M_LOC) in mat4 inst_m;

uniform mat4 M;
uniform mat4 V;
uniform mat4 P;

out vec3 eye_position;

void main() {
    vec4 eye = V * M * inst_m * vec4(position, 1.0);
    eye_position = eye.xyz;
    gl_Position = P * eye;
#ifdef COLOR_0_LOC
    face_color = color_0.rgb;
#endif
}
