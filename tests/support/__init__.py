"""What several test files share. A test file imports helpers from here, never from another one."""
