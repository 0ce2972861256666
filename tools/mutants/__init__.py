"""Mutation score: small mistakes are put into the code at random, one at a time; do the tests notice?"""
