"""`meshdeform eval`: how well prompts become shapes, and how good the meshes stay. See docs/quality.md."""
