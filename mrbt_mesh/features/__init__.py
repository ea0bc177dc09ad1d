"""Optional features of missions: one package each, listed by `mrbt_mesh.core.feature`."""
