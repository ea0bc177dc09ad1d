"""CBAA and CBBA, the decentralised auctions that the planner is compared with.

Source: H.-L. Choi, L. Brunet, J. P. How, "Consensus-Based Decentralized Auctions for Robust Task
Allocation", IEEE Transactions on Robotics 25(4), 2009. Rounds are synchronous: everybody sends
its lists to all neighbours, then everybody takes in what it has received.
"""
