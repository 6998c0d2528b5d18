#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 color;

uniform mat4 world_to_camera;
uniform mat4 camera_to_clip;

out vec3 eye_position;
flat out vec3 face_color;

void main() {
    vec4 eye = world_to_camera * vec4(position, 1.0);
    eye_position = eye.xyz;
    face_color = color;
    gl_Position = camera_to_clip * eye;
}
