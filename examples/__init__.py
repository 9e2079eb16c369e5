"""RoughTurning with other libraries, one script each: what they give is in docs/ecosystem.md."""
