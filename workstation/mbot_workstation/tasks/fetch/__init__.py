"""The paper's task: touch the object, again and again."""
