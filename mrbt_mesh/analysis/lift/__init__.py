"""A team's mission made of a single robot's tree, spread only where its author has marked it.

`marks` finds the marks, `cut` takes the tree apart there and refuses what that would break,
`tasks` has the trees that robots run, `folder` the files of the mission.
"""
