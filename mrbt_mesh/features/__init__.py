"""The features of missions: each package is one, and `mrbt_mesh.core.feature` lists them."""
